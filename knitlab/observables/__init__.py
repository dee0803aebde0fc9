"""What is measured of a test: strains, Poisson's ratio, forces, wavelengths, folds, capacitance.

In: a case and its test. Out: every variable of the case, as a labelled dataset. Read ``schema.py``,
``measurement.py``, then ``unit_cells.py`` (Poisson's ratio) and ``capacitance``. Nothing here
writes a file.
"""
