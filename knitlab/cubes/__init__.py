"""Cubes: every design of a sweep on one labelled grid, as netCDF, and questions to them.

In: cube files, selections and conditions. Out: xarray datasets, tables of designs, the designs that
come closest to targets, comparisons of a simulation with an experiment.

Read ``cube_file.py``, then ``query.py`` and ``find.py``. Reads files only, never imports JAX.
"""
