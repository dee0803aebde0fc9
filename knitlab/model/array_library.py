"""NumPy or JAX's NumPy: one formula for results that are differentiated and for all others."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def array_library(*values: Any) -> Any:
    """JAX's NumPy if any value holds an array of JAX, else NumPy, which compiles nothing."""
    return jnp if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(values)) else np
