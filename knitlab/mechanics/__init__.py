"""A fabric under load: relaxation, the tensile test, dynamics, and derivatives of equilibria.

This package does not depend on files, xarray or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
