"""Every figure that can be drawn by its name: one file for each, which declares all about it.

The first paragraph of its docstring is its description. See :mod:`knitlab.figures.registry`.
"""
