"""What a fabric is: its pattern, its network of springs and hinges, and its energy.

In: a ``Pattern``, calibrated stripes, and model options. Out: a ``Fabric``, whose ``energy`` of a
``Configuration`` (positions of its nodes) is differentiable. Read ``pattern.py``, ``layout.py``
(from a pattern to a network), then ``energy.py`` (the three formulas of the paper). Nothing here
knows solvers, files or xarray.

What computes with JAX runs in ``computing.py``'s context, in float64.
"""
