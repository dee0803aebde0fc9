"""Several electrodes on one fabric: their capacitances, and what moves a reading.

``electrode_set.py`` names electrodes by the ridges or grid cells that they cover, ``maxwell.py``
computes their capacitance matrix, ``crosstalk.py`` and ``selectivity.py`` what a reading depends
on. The capacitance of one knitted capacitor is an observable: ``knitlab.observables.capacitance``.
"""
