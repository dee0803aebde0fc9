"""A law of the cloth: the energy density of a membrane that behaves as the simulated fabric.

Read ``strain_tests.py`` (what a cube says), ``ridge_law.py`` (the law), ``fitting.py``, ``law.py``.
"""
