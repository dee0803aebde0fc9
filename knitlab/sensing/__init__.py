"""Several electrodes on one fabric: their capacitances, and what moves a reading.

In: shapes of a case, and electrodes on its ridges. Out: Maxwell's capacitance matrix, what a sensor
reads when another one is stretched, and what it reads of strain and bending in both directions.

Read ``electrode_set.py``, ``maxwell.py``, then ``selectivity.py`` and ``crosstalk.py``.
"""
