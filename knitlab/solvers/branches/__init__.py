"""Stability: branches of equilibria with their limit and branch points, and relaxed shapes.

In: one case, or any equations of an energy that depends on a parameter. Out: points along
branches, stable and unstable; shapes that a fabric may relax to, and energies between them.

Read ``equations.py`` first, then ``continuation.py``, which follows branches through the points at
which a test snaps; ``shapes.py`` starts from many sheets.
"""
