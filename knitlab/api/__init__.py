"""What ``import knitlab`` offers: one function for each thing that the command line can do.

In: typed values (a design, a protocol, settings) or names of workflows and cubes. Out: xarray
datasets, tables and figures. Every fault of the arguments is one ``InputError``.

Read ``simulation.py`` (one design), ``sweeps.py`` (workflows), ``cubes.py`` (questions to results),
``design.py``, ``laboratory.py``, ``knitting.py``. A function checks its arguments and calls the
core.
"""
