"""Energies of a fabric: stretch, fold and wall, as sums over its elements [N mm]."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.array_library import array_library
from knitlab.fabric.fabric import Configuration, Fabric
from knitlab.fabric.fold_angle import Each, HingeVectors, fold_from_rest
from knitlab.fabric.network import Elements, Network
from knitlab.fabric.settings import FoldAngle
from knitlab.fabric.spring_law import LINEAR, SpringLaw

OneOrEach = Float[Array | np.ndarray, "*#element"]
"""A value of every element, or one of all."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Energy:
    """Elastic energy in its three parts [N mm] (paper, Eqs. 1, 2 and the wall penalty).

    ``drag`` is the potential of the drag while a viscous step is solved, and 0 in every result.
    """

    stretch: Float[Array, "*batch"]
    fold: Float[Array, "*batch"]
    wall: Float[Array, "*batch"]
    drag: Float[Array, "*batch"] | float = 0.0
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

    unknowns: Float[np.ndarray, " unknown"]
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
    across_seam = elements.periods * configuration.lengths[:, None]
    xp = array_library(configuration)
    return xp.stack(vectors) + xp.pad(across_seam, ((0, 0), (0, 1), (0, 0)))


def spring_energy(
    vectors: Float[Array | np.ndarray, "1 3 *element"],
    rest_length: Each,
    stiffness: Each,
    law: SpringLaw = LINEAR,
) -> Each:
    """Energy of springs [N mm]; ½ k_s (ℓ − ℓ0)² if they are linear (paper, Eq. 1)."""
    return jnp.asarray(stiffness) * law.stored(jnp.linalg.norm(vectors[0], axis=0), rest_length)


def hinge_energy(vectors: HingeVectors, rest: Each, stiffness: Each, of: FoldAngle) -> Each:
    """½ k_t (φ − φ0)² of hinges [N mm] (paper, Eq. 1)."""
    return 0.5 * jnp.asarray(stiffness) * fold_from_rest(vectors, rest, of) ** 2


def wall_energy(z: Each, z_max: OneOrEach, k_wall: OneOrEach) -> Each:
    """½ k_wall (δ⁺² + δ⁻²) of nodes at heights z [N mm] (paper, wall penalty)."""
    return 0.5 * jnp.asarray(k_wall) * jnp.maximum(jnp.abs(z) - z_max, 0.0) ** 2


def energy(net: Network, fabric: Fabric, configuration: Configuration) -> Energy:
    """Elastic energy of a configuration, split into its parts [N mm]."""
    springs, hinges = (element_vectors(each, configuration) for each in (net.springs, net.hinges))
    heights = jnp.asarray(configuration.positions[..., 2]).ravel()
    stretch, fold = fabric.stretch_stiffness, fabric.fold_stiffness
    return Energy(
        spring_energy(springs, fabric.rest_length, stretch, fabric.spring_law).sum(),
        hinge_energy(hinges, fabric.rest_fold, fold, fabric.fold_angle).sum(),
        wall_energy(heights, fabric.z_max, fabric.k_wall).sum(),
    )
