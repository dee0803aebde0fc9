"""Figures of cubes, by name: design maps, curves, shapes, samples, comparisons.

Read a file of ``kinds``: each is one figure and declares itself by ``registry.py``. Then read
``drawing.py``, which draws a figure by its name, and ``style.py``. ``claims_page.py`` writes the
page of claims. JAX is imported only inside functions of the figures that need it.
"""
