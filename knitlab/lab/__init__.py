"""Laboratory records: tests of stripes to calibrate, experiments imported into cubes, and fits.

In: a description of an experiment (TOML) and its records. Out: a cube with the variables of a
simulation, each with a standard error; stripes fitted to it.

Read ``calibration.py`` (from a tension curve to a stripe), ``description.py`` (what a user states),
``experiment.py``, then ``markers.py`` and
``machine.py`` for each kind of record; ``fit.py`` adjusts stripes until a simulated sample follows
the measured curves. ``tension_record.py`` reads tests of pure stripes, and
``record_start.py`` says what of their force is an offset or a preload.
"""
