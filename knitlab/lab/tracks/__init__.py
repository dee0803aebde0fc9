"""Tracks of markers: the formats of trackers, checks of positions, and the grid of markers.

Read ``reading.py``. Each program has a file that declares what it recognises and how to read it; a
further format is one such file, and its registration in ``reading.py``.
"""
