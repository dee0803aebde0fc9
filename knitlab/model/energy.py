"""Energies of a fabric: stretch, fold and wall, and the elements they are summed from.

A configuration is one vector: the coordinates of every node, then L_x and L_y, the lengths of
endless fabric (they have no influence on a sheet with open edges). Units are mm, N and rad.
"""

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


def element_unknowns(
    elements: Elements, configuration: Float[Array, " unknown"]
) -> Float[Array, "element unknown"]:
    """Every element's own unknowns: its nodes' coordinates, then L_x and L_y [mm]."""
    coordinates = positions(configuration)[elements.nodes].reshape(len(elements.nodes), -1)
    lengths = jnp.broadcast_to(configuration[-2:], (len(elements.nodes), 2))
    return jnp.concatenate([coordinates, lengths], axis=1)


def _corners(local: Float[Array, " unknown"], images: Float[Array, "node 2"]) -> Array:
    shift = images * local[-2:]
    return local[:-2].reshape(-1, 3) + jnp.pad(shift, ((0, 0), (0, 1)))


def spring_energy(
    local: Float[Array, "8"],
    images: Float[Array, "2 2"],
    rest_length: Float[Array, ""],
    stiffness: Float[Array, ""],
) -> Float[Array, ""]:
    """½ k_s (ℓ − ℓ0)² of one spring [N mm] (paper, Eq. 1)."""
    start, end = _corners(local, images)
    return 0.5 * stiffness * (jnp.linalg.norm(end - start) - rest_length) ** 2


def fold_angle(corners: Float[Array, "6 3"], rest: Float[Array, ""]) -> Float[Array, ""]:
    """Signed fold angle of one hinge, less its rest value, on the branch nearest zero [rad].

    The fold angle is that between the normals of the two cells about their shared edge, positive
    for a mountain; a normal is the cross product of its cell's diagonals. Turning the angle
    back by its rest value before the arctangent keeps the energy smooth but for a hinge exactly
    opposite to its rest.
    """
    a, b, c, d, e, f = corners
    before = jnp.cross(b - c, d - a)
    after = jnp.cross(f - a, b - e)
    edge = (b - a) / jnp.linalg.norm(b - a)
    sine = jnp.dot(jnp.cross(before, after), edge)
    cosine = jnp.dot(before, after)
    cos_rest, sin_rest = jnp.cos(rest), jnp.sin(rest)
    return jnp.arctan2(sine * cos_rest - cosine * sin_rest, cosine * cos_rest + sine * sin_rest)


def hinge_energy(
    local: Float[Array, "20"],
    images: Float[Array, "6 2"],
    rest: Float[Array, ""],
    stiffness: Float[Array, ""],
) -> Float[Array, ""]:
    """½ k_t (φ − φ0)² of one hinge [N mm] (paper, Eq. 1)."""
    return 0.5 * stiffness * fold_angle(_corners(local, images), rest) ** 2


def wall_energy(z: Float[Array, ""], z_max: Float[Array, ""], k_wall: Float[Array, ""]):
    """½ k_wall (δ⁺² + δ⁻²) of one node at height z [N mm] (paper, wall penalty)."""
    return 0.5 * k_wall * jnp.maximum(jnp.abs(z) - z_max, 0.0) ** 2


def energy(net: Network, fabric: Fabric, configuration: Float[Array, " unknown"]) -> Energy:
    """Elastic energy of a configuration, split into its parts [N mm]."""
    springs = jax.vmap(spring_energy)(
        element_unknowns(net.springs, configuration),
        jnp.asarray(net.springs.images, float),
        fabric.rest_length,
        fabric.stretch_stiffness,
    )
    hinges = jax.vmap(hinge_energy)(
        element_unknowns(net.hinges, configuration),
        jnp.asarray(net.hinges.images, float),
        fabric.rest_fold,
        fabric.fold_stiffness,
    )
    heights = positions(configuration)[:, 2]
    walls = wall_energy(heights, fabric.z_max, fabric.k_wall)
    return Energy(springs.sum(), hinges.sum(), walls.sum())
