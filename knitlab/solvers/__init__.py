"""Solvers for equilibria: minimisation, domain decomposition, and the executors that run them.

This package does not depend on tests, files or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
