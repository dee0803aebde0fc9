"""Energy, forces and stiffness of a fabric, assembled from its springs, hinges and walls."""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
