"""Damped dynamics of a fabric as a structured grid: relaxation and a test at a finite rate.

In: a fabric, a loading and ``Dynamics`` (mass, drag, time step). Out: the same ``TensileTest`` as a
quasi-static test has, with its history of energies. Read ``damped_test.py``, then ``motion.py`` (a
step in time) and ``grid.py`` (forces by slices of a grid). ``contact_pairs.py`` lists what may
touch, ``contact_forces.py`` has its forces. Nothing here knows files, xarray or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
