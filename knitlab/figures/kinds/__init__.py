"""Every figure that can be drawn by its name: one file for each, which declares all about it.

``knitlab map NAME``, ``knitlab.plot.NAME``, the ``figures`` of workflows and the reference of the
documentation follow from the file, whose function has the name of the file. The first paragraph of
its docstring describes the figure. See :mod:`knitlab.figures.registry`.
"""
