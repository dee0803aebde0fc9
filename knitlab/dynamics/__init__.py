"""Damped dynamics of fabrics as structured grids: the relaxation and the test at a finite rate.

This package does not depend on files, xarray or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
