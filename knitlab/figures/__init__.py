"""Figures of cubes, by name: design maps, curves, shapes, samples, comparisons.

In: cubes or case files, and selections. Out: matplotlib figures, and files that are written
atomically.

Read a file of ``kinds``, each of which is one figure and declares itself by ``registry.py``, then
``drawing.py``, which draws a figure by its name. ``style.py`` has sizes and colours,
``claims_page.py`` the page of claims. JAX is imported only inside functions of the figures that
need it.
"""
