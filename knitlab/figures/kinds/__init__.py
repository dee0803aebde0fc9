"""Every figure that can be drawn by name: one file each, called as the figure is.

A file holds the function that draws and ``FIGURE``, which describes it (:class:`FigureKind`).
"""
