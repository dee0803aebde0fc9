"""Laboratory records: tests of stripes to calibrate, experiments imported into cubes, and fits.

Read ``tension_record.py`` and ``calibration.py`` (from a tension curve to a stripe); then
``description.py`` (what a user states), ``experiment.py``, and for each kind of record
``markers.py``, with ``tracks/``, and ``machine.py``. ``fit.py`` adjusts stripes until a simulated
sample follows the measured curves.
"""
