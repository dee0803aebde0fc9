"""Energies of a fabric: stretch, fold and wall, and the elements they are summed from.

A configuration is one vector: the coordinates of every node, then L_x and L_y, the lengths of
endless fabric (they have no influence on a sheet with open edges). Units are mm, N and rad.
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.model.fabric import Fabric
from knitlab.model.network import Elements, Network


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Energy:
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
    vectors: Float[Array, "1 3 *element"],
    rest_length: Float[Array, " *element"],
    stiffness: Float[Array, " *element"],
) -> Float[Array, " *element"]:
    """½ k_s (ℓ − ℓ0)² of springs [N mm] (paper, Eq. 1)."""
    return 0.5 * stiffness * (jnp.linalg.norm(vectors[0], axis=0) - rest_length) ** 2


@jax.custom_jvp
def fold_from_rest(
    vectors: Float[Array, "5 3 *element"], rest: Float[Array, " *element"]
) -> Float[Array, " *element"]:
    """Signed fold angle of hinges, less its rest value, on the branch nearest zero [rad].

    The fold angle is that between the normals of the two cells about their shared edge, positive
    for a mountain; a normal is the cross product of its cell's diagonals. The branch keeps the
    energy smooth but for a hinge exactly opposite to its rest.

    Args:
        vectors: the edge and the two diagonals of each cell,
            see :data:`~knitlab.model.network.HINGE_VECTORS`.
        rest: signed fold angle at rest.
    """
    return _fold_and_slope(vectors, rest)[0]


_cross = partial(jnp.cross, axis=0)


def _fold_and_slope(
    vectors: Float[Array, "5 3 *element"], rest: Float[Array, " *element"]
) -> tuple[Float[Array, " *element"], Float[Array, "5 3 *element"]]:
    """The fold angle less its rest value, and its derivative by the vectors.

    φ = atan2(S, C) with S = (n1 × n2)·ê and C = n1·n2, so that φ_S = C/r² and φ_C = −S/r² with
    r² = S² + C².
    """
    edge, *diagonals = vectors
    before = _cross(diagonals[0], diagonals[1])
    after = _cross(diagonals[2], diagonals[3])
    length = jnp.linalg.norm(edge, axis=0)
    along = edge / length
    across = _cross(before, after)
    sine, cosine = (across * along).sum(0), (before * after).sum(0)
    angle = jnp.arctan2(sine, cosine) - rest
    angle -= 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))

    by_sine, by_cosine = jnp.array([cosine, -sine]) / (sine**2 + cosine**2)
    by_before = by_sine * _cross(after, along) + by_cosine * after
    by_after = by_sine * _cross(along, before) + by_cosine * before
    slope = jnp.stack(
        [
            by_sine * (across - sine * along) / length,
            _cross(diagonals[1], by_before),
            _cross(by_before, diagonals[0]),
            _cross(diagonals[3], by_after),
            _cross(by_after, diagonals[2]),
        ]
    )
    return angle, slope


@fold_from_rest.defjvp
def _fold_from_rest_slope(
    primals: tuple[Array, Array], tangents: tuple[Array, Array]
) -> tuple[Array, Array]:
    # In closed form the gradient of a fabric's energy takes half the time.
    angle, slope = _fold_and_slope(*primals)
    return angle, (slope * tangents[0]).sum((0, 1)) - tangents[1]


def hinge_energy(
    vectors: Float[Array, "5 3 *element"],
    rest: Float[Array, " *element"],
    stiffness: Float[Array, " *element"],
) -> Float[Array, " *element"]:
    """½ k_t (φ − φ0)² of hinges [N mm] (paper, Eq. 1)."""
    return 0.5 * stiffness * fold_from_rest(vectors, rest) ** 2


def wall_energy(
    z: Float[Array, "*node"], z_max: Float[Array, ""], k_wall: Float[Array, ""]
) -> Float[Array, "*node"]:
    """½ k_wall (δ⁺² + δ⁻²) of nodes at heights z [N mm] (paper, wall penalty)."""
    return 0.5 * k_wall * jnp.maximum(jnp.abs(z) - z_max, 0.0) ** 2


def energy(net: Network, fabric: Fabric, configuration: Float[Array, " unknown"]) -> Energy:
    """Elastic energy of a configuration, split into its parts [N mm]."""
    springs = spring_energy(
        element_vectors(net.springs, configuration),
        fabric.rest_length,
        fabric.stretch_stiffness,
    )
    hinges = hinge_energy(
        element_vectors(net.hinges, configuration),
        fabric.rest_fold,
        fabric.fold_stiffness,
    )
    heights = positions(configuration)[:, 2]
    walls = wall_energy(heights, fabric.z_max, fabric.k_wall)
    return Energy(springs.sum(), hinges.sum(), walls.sum())
