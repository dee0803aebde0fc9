"""Capacitance of electrodes on a fabric, and figures of merit of a strain sensor.

In: electrodes, and configurations of the fabric that carries them. Out: a capacitance for every
state or the reason why there is none, then sensitivity, linearity and hysteresis.

Read ``capacitor.py`` (the capacitor of a case), ``maxwell.py`` (matrices of any electrodes, and the
extrapolation to ever finer panels), ``panels.py`` and ``boundary_elements.py`` (the method), and
``sensor.py`` (the figures of merit). ``wedge.py`` is the paper's estimate for two strips.
"""
