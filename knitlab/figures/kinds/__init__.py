"""Every figure that can be drawn by name.

A module holds functions that draw, and ``FIGURES``, which describes each by its name
(:class:`~knitlab.figures.figure_kind.FigureKind`).
"""
