"""Contact: parts of a fabric keep a distance of its thickness, by a barrier potential."""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
