"""Stability: branches of equilibria with their limit and branch points, and relaxed shapes.

Read ``equations.py`` (any energy that depends on a parameter), then ``continuation.py``, which
follows branches through the points at which a test snaps; ``shapes.py`` starts from many sheets.
"""
