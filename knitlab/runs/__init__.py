"""Sweeps: from a workflow to a plan of cases, their simulation, and the cube that they fill.

In: a workflow (TOML, or values from Python). Out: a results folder with ``plan.json``, a file for
each case, and ``cube.nc``.

Read ``workflow.py`` (the schema), ``material.py`` (another yarn in place of the paper's),
``plan.py`` (designs, settings and cases, resolved once), then
``run.py``, ``workers.py`` and ``cube.py``. A run that was stopped continues; ``merge.py`` joins the
results of several machines.
"""
