"""Energies of a fabric: stretch, fold and wall, and the elements they are summed from.

A configuration is one vector: the coordinates of every node, then L_x and L_y, the lengths of
endless fabric (they have no influence on a sheet with open edges). Units are mm, N and rad.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.model.fabric import Fabric
from knitlab.model.network import Elements, Network


class Energy(eqx.Module):
    """Elastic energy in its three parts [N mm] (paper, Eqs. 1, 2 and the wall penalty)."""

    stretch: Float[Array, ""]
    fold: Float[Array, ""]
    wall: Float[Array, ""]

    @property
    def total(self) -> Float[Array, ""]:
        """Their sum, V."""
        return self.stretch + self.fold + self.wall


def positions(configuration: Float[Array, " unknown"]) -> Float[Array, "node 3"]:
    """Node positions of a configuration [mm]."""
    return configuration[:-2].reshape(-1, 3)


def element_vectors(
    elements: Elements, configuration: Float[Array, " unknown"]
) -> Float[Array, "vector 3 element"]:
    """The vectors that every element's energy hangs on [mm]; elements last, for speed."""
    columns = positions(configuration).T
    corners = [columns[:, nodes] for nodes in elements.nodes.T]
    vectors = [corners[end] - corners[start] for start, end in elements.ends]
    across_seam = elements.periods * configuration[-2:, None]
    return jnp.stack(vectors) + jnp.pad(across_seam, ((0, 0), (0, 1), (0, 0)))


def spring_energy(
    vectors: Float[Array, "1 3"], rest_length: Float[Array, ""], stiffness: Float[Array, ""]
) -> Float[Array, ""]:
    """½ k_s (ℓ − ℓ0)² of one spring [N mm] (paper, Eq. 1)."""
    return 0.5 * stiffness * (jnp.linalg.norm(vectors[0]) - rest_length) ** 2


def fold_from_rest(vectors: Float[Array, "5 3"], rest: Float[Array, ""]) -> Float[Array, ""]:
    """Signed fold angle of one hinge, less its rest value, on the branch nearest zero [rad].

    The fold angle is that between the normals of the two cells about their shared edge, positive
    for a mountain; a normal is the cross product of its cell's diagonals. Turning the angle
    back by its rest value before the arctangent keeps the energy smooth but for a hinge exactly
    opposite to its rest.

    Args:
        vectors: the edge and the two diagonals of each cell,
            see :data:`~knitlab.model.network.HINGE_VECTORS`.
        rest: signed fold angle at rest.
    """
    edge, *diagonals = vectors
    before = jnp.cross(diagonals[0], diagonals[1])
    after = jnp.cross(diagonals[2], diagonals[3])
    sine = jnp.dot(jnp.cross(before, after), edge) / jnp.linalg.norm(edge)
    cosine = jnp.dot(before, after)
    cos_rest, sin_rest = jnp.cos(rest), jnp.sin(rest)
    return jnp.arctan2(sine * cos_rest - cosine * sin_rest, cosine * cos_rest + sine * sin_rest)


def hinge_energy(
    vectors: Float[Array, "5 3"], rest: Float[Array, ""], stiffness: Float[Array, ""]
) -> Float[Array, ""]:
    """½ k_t (φ − φ0)² of one hinge [N mm] (paper, Eq. 1)."""
    return 0.5 * stiffness * fold_from_rest(vectors, rest) ** 2


def wall_energy(
    z: Float[Array, ""], z_max: Float[Array, ""], k_wall: Float[Array, ""]
) -> Float[Array, ""]:
    """½ k_wall (δ⁺² + δ⁻²) of one node at height z [N mm] (paper, wall penalty)."""
    return 0.5 * k_wall * jnp.maximum(jnp.abs(z) - z_max, 0.0) ** 2


def over_elements(function: Callable[..., Array]) -> Callable[..., Array]:
    """A function of one element's vectors and two of its numbers, for all elements at once."""
    return jax.vmap(function, in_axes=(-1, 0, 0))


def energy(net: Network, fabric: Fabric, configuration: Float[Array, " unknown"]) -> Energy:
    """Elastic energy of a configuration, split into its parts [N mm]."""
    springs = over_elements(spring_energy)(
        element_vectors(net.springs, configuration),
        fabric.rest_length,
        fabric.stretch_stiffness,
    )
    hinges = over_elements(hinge_energy)(
        element_vectors(net.hinges, configuration),
        fabric.rest_fold,
        fabric.fold_stiffness,
    )
    heights = positions(configuration)[:, 2]
    walls = wall_energy(heights, fabric.z_max, fabric.k_wall)
    return Energy(springs.sum(), hinges.sum(), walls.sum())
