"""Second derivatives of the energies of springs and walls."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.energy import wall_energy
from knitlab.fabric.spring_law import LINEAR, SpringLaw

SPRING_ENTRIES = np.tril_indices(3)
"""Rows and columns of the entries of a spring's stiffness that are kept."""


def spring_stiffness(
    vectors: Float[Array | np.ndarray, "3 spring"],
    rest_length: Float[Array | np.ndarray, " spring"],
    stiffness: Float[Array | np.ndarray, " spring"],
    law: SpringLaw = LINEAR,
) -> Float[Array, "6 spring"]:
    """Hessian of the energy of springs with respect to their vectors, lower triangle [N/mm].

    For a linear spring it is k_s along the spring, and tension over length, k_s (1 − ℓ0/ℓ), across
    it.
    """
    length = jnp.sqrt((vectors**2).sum(0))
    along = vectors / length
    stretching = stiffness * law.slope(length, rest_length)
    across = stiffness * law.pull_over_length(length, rest_length)
    outer = along[:, None] * along[None, :]
    hessian = (stretching - across) * outer + across * jnp.eye(3)[:, :, None]
    return jnp.asarray(hessian[SPRING_ENTRIES])


def wall_stiffness(
    heights: Float[Array | np.ndarray, " node"],
    z_max: Float[Array | np.ndarray, "*#node"],
    k_wall: Float[Array | np.ndarray, "*#node"],
) -> Float[Array, " node"]:
    """Second derivative of the wall penalty with respect to the height of every node [N/mm]."""
    walls = (jnp.broadcast_to(number, heights.shape) for number in (z_max, k_wall))
    return jax.vmap(jax.grad(jax.grad(wall_energy)))(heights, *walls)
