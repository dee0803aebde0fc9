"""What is read off a fabric: local strain and Poisson's ratio, wavelength, folds.

The same functions serve a simulation and laboratory markers; they know no solver and no file.
"""
