"""What ``import knitlab`` offers: one function for each thing that the command line can do.

In: a cube, a workflow or a design, and typed settings. Out: xarray datasets, tables and figures.
Every invalid argument is an ``InputError``. A function checks its arguments and calls the core.

The calls have one form:

- ``f(cube, …, selections, **named)``: a cube is a dataset, its file or its results folder;
  selections are values of its coordinates, as a mapping or as keywords.
- ``f(workflow, overrides, …, **settings)``: a workflow is a name or a file; overrides replace its
  settings as text, ``"n_stripe=4"``, settings as keywords.
- ``output=`` is the file to write, if any.
"""
