"""Measures of a fabric: local strain and Poisson's ratio, wavelength, folds, size, calibration.

In: positions of unit cells' corners or of nodes, from a simulation or from tracked markers; curves
of a test. Out: numbers and arrays; for a calibration, the stripe that a curve determines.

Read ``unit_cells.py`` (Poisson's ratio), ``wavelength.py``, ``calibration.py``; ``capacitance``
computes what electrodes on the fabric sense. Nothing here writes a cube.
"""
