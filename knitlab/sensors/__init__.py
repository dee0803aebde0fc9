"""Several electrodes on one fabric: their capacitances, and what changes a reading.

In: a case with electrodes, and its states. Out: capacitance matrices, cross-talk, and gauge factors
of strain and bending.

Read ``electrode_set.py`` (names of electrodes), ``readings.py`` (matrices, and what a meter shows),
then ``crosstalk.py`` and ``selectivity.py``. Capacitances themselves are computed in
``knitlab.observables.capacitance``.
"""
