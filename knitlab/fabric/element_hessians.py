"""Second derivatives of the energies of elements: springs, hinges and walls."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.energy import OneOrEach, wall_energy
from knitlab.fabric.fold_angle import (
    Each,
    HingeVectors,
    Vector,
    by_hinge_vectors,
    fold_from_normals,
)
from knitlab.fabric.network import HINGE_VECTORS
from knitlab.fabric.settings import FoldAngle
from knitlab.fabric.spring_law import LINEAR, SpringLaw

SPRING_ENTRIES = np.tril_indices(3)
"""Rows and columns of the entries of a spring's stiffness that are kept."""
HINGE_ENTRIES = np.tril_indices(3 * 6)
"""Rows and columns (3 × node + component) of the entries of a hinge's stiffness that are kept."""
LANES = 64
"""Number of hinges in a block, so that their intermediate values stay in the fastest cache."""


class ElementHessians(eqx.Module):
    """Second derivatives of the energies of springs, hinges and walls [N/mm]."""

    springs: Float[Array | np.ndarray, "*batch 6 spring"]
    hinges: Float[Array | np.ndarray, "*batch block 171 lane"]
    walls: Float[Array | np.ndarray, "*batch node"]


def spring_stiffness(
    vectors: Vector,
    rest_length: Each,
    stiffness: Each,
    law: SpringLaw = LINEAR,
) -> Float[Array, "6 spring"]:
    """Hessian of springs with respect to their vectors, :data:`SPRING_ENTRIES` of it [N/mm].

    Of a linear spring it is k_s along it and tension over length, k_s (1 − ℓ0/ℓ), across it.
    """
    length = jnp.sqrt((vectors**2).sum(0))
    along = vectors / length
    stretching = stiffness * law.slope(length, rest_length)
    across = stiffness * law.pull_over_length(length, rest_length)
    outer = along[:, None] * along[None, :]
    hessian = (stretching - across) * outer + across * jnp.eye(3)[:, :, None]
    return jnp.asarray(hessian[SPRING_ENTRIES])


def wall_stiffness(heights: Each, z_max: OneOrEach, k_wall: OneOrEach) -> Each:
    """Second derivative of the wall penalty with respect to the height of every node [N/mm]."""
    walls = (jnp.broadcast_to(number, heights.shape) for number in (z_max, k_wall))
    return jax.vmap(jax.grad(jax.grad(wall_energy)))(heights, *walls)


def hinge_stiffness(
    vectors: HingeVectors, rest: Each, stiffness: Each, of: FoldAngle
) -> Float[Array, "block 171 lane"]:
    """Hessian of ½ k_t (φ − φ0)² with respect to the six nodes, :data:`HINGE_ENTRIES` of it [N/mm].

    In blocks of :data:`LANES` hinges; vectors see :data:`~knitlab.fabric.network.HINGE_VECTORS`.
    """
    hinges = (
        jnp.moveaxis(vectors.reshape(5, 3, -1, LANES), 2, 0),
        rest.reshape(-1, LANES),
        stiffness.reshape(-1, LANES),
    )
    return jax.lax.map(lambda block: _hinge_entries(block[0], block[1], block[2], of), hinges)


def _hinge_entries(
    vectors: Float[Array, "5 3 lane"], rest: Each, stiffness: Each, of: FoldAngle
) -> Float[Array, "171 lane"]:
    """Hessians of one block: by the edge and the normals beside it, by the vectors, by the nodes.

    Differentiating with respect to the nodes at once would take twice the time.
    """
    diagonals = vectors[1:]
    normals = jnp.cross(diagonals[::2], diagonals[1::2], axis=1)
    three = jnp.concatenate([vectors[:1], normals])

    def gradient(three: Float[Array, "3 3 lane"]) -> Float[Array, "3 3 lane"]:
        angle, slopes = fold_from_normals(three[0], three[1], three[2], rest, of)
        return jnp.asarray(stiffness) * angle * jnp.stack(slopes)

    slopes, along = jax.linearize(gradient, three)
    units = jnp.eye(9).reshape(9, 3, 3, 1)
    by_three = jax.vmap(lambda unit: along(jnp.broadcast_to(unit, three.shape)))(units)
    hessian = by_three.reshape(3, 3, 3, 3, LANES)
    for _ in range(2):
        hessian = by_hinge_vectors(hessian, diagonals).transpose(2, 3, 0, 1, 4)
    for normal, first, second in ((1, 1, 2), (2, 3, 4)):
        # Second derivative of the normal, a product of two diagonals: skew-symmetric.
        mixed = jnp.cross(jnp.eye(3)[:, :, None], slopes[normal][:, None], axis=0)
        hessian = hessian.at[first, :, second].add(mixed).at[second, :, first].add(-mixed)
    for _ in range(2):
        hessian = _by_nodes(hessian).transpose(2, 3, 0, 1, 4)
    return hessian.reshape(18, 18, LANES)[HINGE_ENTRIES]


def _by_nodes(by_vectors: Float[Array, "5 ..."]) -> Float[Array, "6 ..."]:
    """Derivatives with respect to the nodes of a hinge, from those with respect to its vectors."""
    return jnp.stack(
        [
            sum(sign * by_vectors[vector] for vector, sign in enumerate(signs) if sign)
            for signs in HINGE_VECTORS.T.tolist()
        ]
    )
