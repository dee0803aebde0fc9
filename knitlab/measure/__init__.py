"""What is read off a fabric: local strain and Poisson's ratio.

The same functions serve a simulation and laboratory markers; they know no solver and no file.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
