"""Several electrodes on one fabric: capacitance matrices, cross-talk, and gauge factors.

Read ``electrode_set.py`` (names of electrodes), ``readings.py`` (matrices, and what a meter shows),
then ``crosstalk.py`` and ``selectivity.py``. ``observables.capacitance`` computes capacitances.
"""
