"""Laboratory records: tests of stripes to calibrate, experiments imported into cubes, and fits.

In: a description of an experiment (TOML) and its records. Out: a cube with the variables of a
simulation, each with a standard error; stripes fitted to it.

Read ``tension_record.py`` (tests of pure stripes; ``record_start.py`` tells an offset of the load
cell from a preload) and ``calibration.py`` (from a tension curve to a stripe); then
``description.py`` (what a user states), ``experiment.py``, and for each kind of record
``markers.py``, with ``tracks/``, and ``machine.py``. ``fit.py`` adjusts stripes until a simulated
sample follows the measured curves.
"""
