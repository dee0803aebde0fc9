"""Energies of a fabric, stretch, fold and wall, as sums over its elements, and their Hessians."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.array_library import array_library
from knitlab.model.fabric import Configuration, Fabric, Unknowns
from knitlab.model.fold_angle import (
    Each,
    HingeVectors,
    Vector,
    fold_and_slope,
    fold_from_normals,
    fold_from_rest,
    hinge_vector_slopes,
)
from knitlab.model.fold_friction import FoldFriction
from knitlab.model.network import HINGE_VECTORS, Elements, Network
from knitlab.model.settings import FoldAngle
from knitlab.model.spring_law import LINEAR, SpringLaw

SPRING_ENTRIES = np.tril_indices(3)  # rows and columns kept of a spring's stiffness
HINGE_ENTRIES = np.tril_indices(3 * 6)  # rows and columns (3 × node + component) kept of a hinge's
LANES = 64  # hinges in a block: their intermediate values stay in the fastest cache

OneOrEach = Float[Array | np.ndarray, "*#element"]  # of every element, or one of all


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Energy:
    """Elastic energy in its parts [N mm] (paper, Eqs. 1, 2 and the wall penalty)."""

    stretch: Float[Array, "*batch"]
    fold: Float[Array, "*batch"]
    wall: Float[Array, "*batch"]
    drag: Float[Array, "*batch"] | float = 0.0  # while a viscous step is solved
    contact: Float[Array, "*batch"] | float = 0.0

    @property
    def total(self) -> Float[Array, "*batch"]:
        """Sum of the parts: V or, while a viscous step is solved, the incremental potential."""
        return self.stretch + self.fold + self.wall + self.drag + self.contact


class Stage(eqx.Module):
    """A stage on the way from the flat sheet: fractions of rest angles and of wall stiffness."""

    fold: Float[Array, ""] | float = 1.0
    wall: Float[Array, ""] | float = 1.0


COMPLETE = Stage()


@dataclass(frozen=True)
class Point:
    """A configuration, flattened [mm], and a stage, at which a fabric is evaluated."""

    unknowns: Unknowns
    stage: Stage = COMPLETE


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Evaluation:
    """Energy [N mm] and its gradient, the negative force on every unknown [N]."""

    energy: Energy
    gradient: Float[Array, "*batch unknown"]


def element_vectors(
    elements: Elements, configuration: Configuration
) -> Float[Array, "vector 3 element"]:
    """The vectors on which every element's energy depends [mm]; last axis elements, for speed."""
    columns = configuration.positions.reshape(-1, 3).T
    corners = [columns[:, nodes] for nodes in elements.nodes.T]
    vectors = [corners[end] - corners[start] for start, end in elements.ends]
    xp = array_library(configuration)
    periods = elements.periods
    across_seam = periods * configuration.lengths[:2, None]
    if configuration.lengths.shape[0] > 2:
        shear = configuration.lengths[2] * periods[:, 1:]
        across_seam = across_seam + xp.pad(shear, ((0, 0), (0, 1), (0, 0)))
    return xp.stack(vectors) + xp.pad(across_seam, ((0, 0), (0, 1), (0, 0)))


def folds_from_rest(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Float[np.ndarray, " hinge"]:
    """Fold angles of all hinges minus their rest values, between ±π, in NumPy [rad]."""
    vectors = element_vectors(net.hinges, configuration)
    rest = np.asarray(fabric.rest_fold)
    return np.asarray(fold_and_slope(vectors, rest, fabric.fold_angle)[0])


def fold_angles(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Float[np.ndarray, "*state hinge"]:
    """Signed fold angle of every hinge in every state, on the branch nearest its rest angle [rad].

    Flat is 0, a mountain fold positive. Beyond ±π, where cells have passed through each other, the
    angle continues smoothly.
    """
    positions = np.asarray(configuration.positions)
    lengths = np.asarray(configuration.lengths)
    rest = np.asarray(fabric.rest_fold)
    angles = np.empty((*lengths.shape[:-1], len(rest)))
    for state in np.ndindex(*lengths.shape[:-1]):
        one = Configuration(positions[state], lengths[state])
        angles[state] = rest + folds_from_rest(net, fabric, one)
    return angles


def spring_energy(
    vectors: Float[Array | np.ndarray, "1 3 *element"],
    rest_length: Each,
    stiffness: Each,
    law: SpringLaw = LINEAR,
) -> Each:
    """Energy of springs [N mm]; ½ k_s (ℓ − ℓ0)² if they are linear (paper, Eq. 1)."""
    return jnp.asarray(stiffness) * law.stored(jnp.linalg.norm(vectors[0], axis=0), rest_length)


def hinge_energy(
    vectors: HingeVectors,
    rest: Each,
    stiffness: Each,
    of: FoldAngle,
    friction: FoldFriction | None = None,
) -> Each:
    """½ k_t (φ − φ0)² of hinges [N mm] (paper, Eq. 1), and the potential of their friction."""
    angle = fold_from_rest(vectors, rest, of)
    elastic = 0.5 * jnp.asarray(stiffness) * angle**2
    return elastic if friction is None else elastic + friction.stored(angle)


def wall_energy(z: Each, z_max: OneOrEach, k_wall: OneOrEach) -> Each:
    """½ k_wall (δ⁺² + δ⁻²) of nodes at heights z [N mm] (paper, wall penalty)."""
    return 0.5 * jnp.asarray(k_wall) * jnp.maximum(jnp.abs(z) - z_max, 0.0) ** 2


def energy(net: Network, fabric: Fabric, configuration: Configuration) -> Energy:
    """Elastic energy of a configuration, split into its parts [N mm]."""
    springs, hinges = (element_vectors(each, configuration) for each in (net.springs, net.hinges))
    heights = jnp.asarray(configuration.positions[..., 2]).ravel()
    stretch = fabric.stretch_stiffness
    fold = fabric.fold_stiffness
    return Energy(
        spring_energy(springs, fabric.rest_length, stretch, fabric.spring_law).sum(),
        hinge_energy(hinges, fabric.rest_fold, fold, fabric.fold_angle, fabric.friction).sum(),
        wall_energy(heights, fabric.z_max, fabric.k_wall).sum(),
    )


class ElementHessians(eqx.Module):
    """Second derivatives of the energies of springs, hinges and walls [N/mm]."""

    springs: Float[Array | np.ndarray, "*batch 6 spring"]
    hinges: Float[Array | np.ndarray, "*batch block 171 lane"]
    walls: Float[Array | np.ndarray, "*batch node"]


def spring_stiffness(
    vectors: Vector, rest_length: Each, stiffness: Each, law: SpringLaw = LINEAR
) -> Float[Array, "6 spring"]:
    """Hessian of springs with respect to their vectors, :data:`SPRING_ENTRIES` of it [N/mm]."""
    length = jnp.sqrt((vectors**2).sum(0))
    along = vectors / length
    stretching = stiffness * law.slope(length, rest_length)
    across = stiffness * law.pull_over_length(length, rest_length)
    outer = along[:, None] * along[None, :]
    hessian = (stretching - across) * outer + across * jnp.eye(3)[:, :, None]
    return jnp.asarray(hessian[SPRING_ENTRIES])


def wall_stiffness(heights: Each, z_max: OneOrEach, k_wall: OneOrEach) -> Each:
    """Second derivative of the wall penalty with respect to the height of every node [N/mm]."""
    return jnp.where(jnp.abs(heights) > z_max, k_wall, 0.0)


def hinge_stiffness(
    vectors: HingeVectors,
    rest: Each,
    stiffness: Each,
    of: FoldAngle,
    friction: FoldFriction | None = None,
) -> Float[Array, "block 171 lane"]:
    """Hessian of hinges by their six nodes, :data:`HINGE_ENTRIES` of it, in blocks [N/mm]."""
    own = jax.tree.map(lambda each: each.reshape(-1, LANES), (rest, stiffness, friction))
    hinges = jnp.moveaxis(vectors.reshape(5, 3, -1, LANES), 2, 0), *own
    return jax.lax.map(lambda block: _hinge_entries(*block, of=of), hinges)


def _hinge_entries(
    vectors: Float[Array, "5 3 lane"],
    rest: Each,
    stiffness: Each,
    friction: FoldFriction | None,
    *,
    of: FoldAngle,
) -> Float[Array, "171 lane"]:
    """Hessians by edge and normals, then vectors, then nodes, in half the time of nodes at once."""
    diagonals = vectors[1:]
    normals = jnp.cross(diagonals[::2], diagonals[1::2], axis=1)
    three = jnp.concatenate([vectors[:1], normals])

    def gradient(three: Float[Array, "3 3 lane"]) -> Float[Array, "3 3 lane"]:
        angle, slopes = fold_from_normals(three[0], three[1], three[2], rest, of)
        moment = jnp.asarray(stiffness) * angle
        if friction is not None:
            moment = moment + friction.moments(angle)
        return moment * jnp.stack(slopes)

    slopes, along = jax.linearize(gradient, three)
    units = jnp.eye(9).reshape(9, 3, 3, 1)
    by_three = jax.vmap(lambda unit: along(jnp.broadcast_to(unit, three.shape)))(units)
    hessian = by_three.reshape(3, 3, 3, 3, LANES)
    for _ in range(2):
        hessian = hinge_vector_slopes(hessian, diagonals).transpose(2, 3, 0, 1, 4)
    for normal, first, second in ((1, 1, 2), (2, 3, 4)):
        # Second derivative of the normal, a product of two diagonals: skew-symmetric.
        mixed = jnp.cross(jnp.eye(3)[:, :, None], slopes[normal][:, None], axis=0)
        hessian = hessian.at[first, :, second].add(mixed).at[second, :, first].add(-mixed)
    for _ in range(2):
        hessian = _node_derivatives(hessian).transpose(2, 3, 0, 1, 4)
    return hessian.reshape(18, 18, LANES)[HINGE_ENTRIES]


def _node_derivatives(by_vectors: Float[Array, "5 ..."]) -> Float[Array, "6 ..."]:
    return jnp.stack(
        [
            sum(sign * by_vectors[vector] for vector, sign in enumerate(signs) if sign)
            for signs in HINGE_VECTORS.T.tolist()
        ]
    )
