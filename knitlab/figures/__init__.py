"""Figures of cubes, by name: design maps, curves, shapes, samples, comparisons.

In: cubes or case files, and selections. Out: matplotlib figures, and files that are written
atomically.

Read ``kinds/__init__.py`` (what a figure takes), a file of ``kinds``, then ``drawing.py``, which
finds a figure by its name. ``style.py`` has sizes and colours, ``claims_page.py`` the page of
claims. Reads files; JAX is imported only inside functions of the figures that need it.
"""
