"""Measures of a fabric: local strain and Poisson's ratio, wavelength, folds.

The same functions apply to simulations and to laboratory markers; they use no solver and no file.
"""
