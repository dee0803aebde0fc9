"""Capacitance of electrodes on a fabric, and figures of merit of a strain sensor.

Read ``capacitor.py`` (the capacitor of a case), ``maxwell.py`` (matrices of any electrodes),
``panels.py`` and ``boundary_elements.py`` (the method), and ``sensor.py`` (the figures of merit).
``wedge.py`` is the paper's estimate for two strips.
"""
