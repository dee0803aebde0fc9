"""How a fabric moves: equilibrium and the loadings that carry it from state to state.

This room knows nothing of files, xarray or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
