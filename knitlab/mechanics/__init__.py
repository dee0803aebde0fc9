"""Equilibria and dynamics of a fabric, the tensile test, and derivatives.

This package does not depend on files, xarray or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
