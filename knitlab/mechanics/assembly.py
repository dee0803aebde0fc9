"""Assembly: energy, forces and stiffness of a batch of fabrics on one fixed sparsity.

Element Hessians come from JAX and are summed into the non-zeros of the sparse stiffness matrix
inside one program, compiled once for a mesh shape and batch size.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.energy import (
    Energy,
    element_unknowns,
    energy,
    hinge_energy,
    positions,
    spring_energy,
    wall_energy,
)
from knitlab.model.fabric import Fabric
from knitlab.model.network import Elements, MeshShape, Network, network


class Evaluation(eqx.Module):
    """What a configuration costs, and how that changes.

    Attributes:
        energy: its parts [N mm].
        gradient: ∂V/∂(configuration), minus the force on every unknown [N].
        stiffness: non-zeros of ∂²V, in the order of the network's sparsity [N/mm].
    """

    energy: Energy
    gradient: Float[Array, "*batch unknown"]
    stiffness: Float[Array, "*batch nonzero"]


@dataclass(frozen=True, eq=False)
class Sparsity:
    """Compressed-column sparsity of the full stiffness matrix, both triangles.

    Attributes:
        indptr, indices: as in :class:`scipy.sparse.csc_array`.
        spring_slots, hinge_slots: non-zero that each entry of each element Hessian adds to; one
            past the last for entries that are left out.
        wall_slots: non-zero that the curvature of the wall at each node adds to.
    """

    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    spring_slots: Int[np.ndarray, " entry"]
    hinge_slots: Int[np.ndarray, " entry"]
    wall_slots: Int[np.ndarray, " node"]

    @property
    def nonzeros(self) -> int:
        """Number of stored entries."""
        return len(self.indices)


@lru_cache(maxsize=16)
def sparsity(shape: MeshShape) -> Sparsity:
    """Sparsity of the stiffness of a mesh shape's network, every diagonal entry included."""
    net, unknowns = network(shape), shape.unknowns
    nowhere = unknowns * unknowns

    def keys(elements: Elements) -> Int[np.ndarray, " entry"]:
        rows, columns = elements.unknowns[:, :, None], elements.unknowns[:, None, :]
        left_out = (rows < 0) | (columns < 0)
        return np.where(left_out, nowhere, columns * unknowns + rows).ravel()

    diagonal = np.arange(unknowns) * (unknowns + 1)
    spring_keys, hinge_keys = keys(net.springs), keys(net.hinges)
    present = np.unique(np.concatenate([spring_keys, hinge_keys, diagonal]))
    present = present[present < nowhere]
    columns, indices = np.divmod(present, unknowns)
    heights = 3 * np.arange(shape.nodes) + 2
    return Sparsity(
        indptr=np.searchsorted(columns, np.arange(unknowns + 1)).astype(np.int32),
        indices=indices.astype(np.int32),
        spring_slots=np.searchsorted(present, spring_keys),
        hinge_slots=np.searchsorted(present, hinge_keys),
        wall_slots=np.searchsorted(present, diagonal[heights]),
    )


def part_folded(fabric: Fabric, fraction: Float[Array, ""]) -> Fabric:
    """The fabric with every rest fold angle at a fraction of its own; 0 rests flat."""
    return eqx.tree_at(lambda f: f.rest_fold, fabric, fraction * fabric.rest_fold)


def evaluate(
    net: Network,
    fabric: Fabric,
    fold_fraction: Float[Array, ""],
    configuration: Float[Array, " unknown"],
) -> Evaluation:
    """Energy, gradient and stiffness of one fabric in one configuration.

    Args:
        net: the network of the fabric's mesh shape.
        fabric: its numbers.
        fold_fraction: fraction of the rest fold angles that acts, 1 but while relaxing.
        configuration: node coordinates, then L_x and L_y [mm].
    """
    slots = sparsity(net.shape)
    fabric = part_folded(fabric, fold_fraction)

    def total(q: Float[Array, " unknown"]) -> tuple[Array, Energy]:
        parts = energy(net, fabric, q)
        return parts.total, parts

    gradient, parts = jax.grad(total, has_aux=True)(configuration)

    springs = jax.vmap(jax.hessian(spring_energy))(
        element_unknowns(net.springs, configuration),
        jnp.asarray(net.springs.images, float),
        fabric.rest_length,
        fabric.stretch_stiffness,
    )
    hinges = jax.vmap(jax.hessian(hinge_energy))(
        element_unknowns(net.hinges, configuration),
        jnp.asarray(net.hinges.images, float),
        fabric.rest_fold,
        fabric.fold_stiffness,
    )
    wall_curvature = jax.vmap(jax.grad(jax.grad(wall_energy)), (0, None, None))
    walls = wall_curvature(positions(configuration)[:, 2], fabric.z_max, fabric.k_wall)

    stiffness = jnp.zeros(slots.nonzeros + 1)
    stiffness = stiffness.at[slots.spring_slots].add(springs.ravel())
    stiffness = stiffness.at[slots.hinge_slots].add(hinges.ravel())
    stiffness = stiffness.at[slots.wall_slots].add(walls)
    return Evaluation(parts, gradient, stiffness[:-1])


BatchEvaluator = Callable[
    [Fabric, Float[Array, " case"], Float[Array, "case unknown"]], Evaluation
]


@lru_cache(maxsize=16)
def batch_evaluator(shape: MeshShape) -> BatchEvaluator:
    """Compiled :func:`evaluate` for a batch of fabrics stacked along their first axis."""
    return jax.jit(jax.vmap(lambda *case: evaluate(network(shape), *case)))
