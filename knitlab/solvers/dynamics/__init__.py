"""Damped dynamics of a fabric as a structured grid: relaxation and a test at a finite rate.

In: a fabric, a loading and ``Dynamics`` (mass, drag, time step). Out: the same ``TensileTest`` as a
quasi-static test has, with its history of energies. Read ``damped_test.py``, then ``motion.py`` (a
step in time) and ``grid.py`` (forces by slices of a grid). Of contact, ``contact_lists.py`` says
which pairs act, ``contact_potential.py`` is their energy, and ``contact_forces.py`` has their
forces in a step. Nothing here knows files, xarray or designs.
"""
