"""NumPy or JAX's NumPy: one formula for results that are differentiated and for all others."""

import sys
from typing import Any

import numpy as np


def array_library(*values: Any) -> Any:
    """JAX's NumPy if any value holds an array of JAX, else NumPy, which compiles nothing."""
    jax = sys.modules.get("jax")  # before it is imported, no value is an array of it
    if jax is None or not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(values)):
        return np
    return jax.numpy
