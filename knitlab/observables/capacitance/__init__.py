"""Capacitance of electrodes on a fabric, and its figures of merit as a strain sensor.

In: electrodes, and configurations of the fabric that carries them. Out: a capacitance for every
state or the reason why it has none, then sensitivity, linearity and hysteresis.

Read ``capacitor.py``, then ``boundary_elements.py`` (the method) and ``sensor.py`` (the figures of
merit). ``wedge.py`` is the paper's estimate for two strips.
"""
