"""Evaluation: energy, forces and element Hessians of a batch of fabrics, in one JAX program.

The program is compiled once for a mesh shape and batch size and vmapped over the batch.
"""

from collections.abc import Callable
from functools import lru_cache

import equinox as eqx
import jax
from jaxtyping import Array, Float

from knitlab.model.energy import (
    Energy,
    element_vectors,
    energy,
    hinge_energy,
    over_elements,
    positions,
    spring_energy,
    wall_energy,
)
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape, Network, network


class Evaluation(eqx.Module):
    """What a configuration costs, and how that changes.

    Attributes:
        energy: its parts [N mm].
        gradient: ∂V/∂(configuration), minus the force on every unknown [N].
        springs: Hessian of every spring's energy by its vector [N/mm].
        hinges: Hessian of every hinge's energy by its five vectors [N/mm].
        walls: second derivative of the wall penalty by every node's height [N/mm].
    """

    energy: Energy
    gradient: Float[Array, "*batch unknown"]
    springs: Float[Array, "*batch spring 1 3 1 3"]
    hinges: Float[Array, "*batch hinge 5 3 5 3"]
    walls: Float[Array, "*batch node"]


def part_folded(fabric: Fabric, fraction: Float[Array, ""]) -> Fabric:
    """The fabric with every rest fold angle at a fraction of its own; 0 rests flat."""
    return eqx.tree_at(lambda f: f.rest_fold, fabric, fraction * fabric.rest_fold)


def evaluate(
    net: Network,
    fabric: Fabric,
    fold_fraction: Float[Array, ""],
    configuration: Float[Array, " unknown"],
) -> Evaluation:
    """Energy, gradient and element Hessians of one fabric in one configuration.

    Args:
        net: the network of the fabric's mesh shape.
        fabric: its numbers.
        fold_fraction: fraction of the rest fold angles that acts, 1 but while relaxing.
        configuration: node coordinates, then L_x and L_y [mm].
    """
    fabric = part_folded(fabric, fold_fraction)

    def total(q: Float[Array, " unknown"]) -> tuple[Array, Energy]:
        parts = energy(net, fabric, q)
        return parts.total, parts

    gradient, parts = jax.grad(total, has_aux=True)(configuration)
    springs = over_elements(jax.hessian(spring_energy))(
        element_vectors(net.springs, configuration), fabric.rest_length, fabric.stretch_stiffness
    )
    hinges = over_elements(jax.hessian(hinge_energy))(
        element_vectors(net.hinges, configuration), fabric.rest_fold, fabric.fold_stiffness
    )
    curvature = jax.vmap(jax.grad(jax.grad(wall_energy)), (0, None, None))
    walls = curvature(positions(configuration)[:, 2], fabric.z_max, fabric.k_wall)
    return Evaluation(parts, gradient, springs, hinges, walls)


BatchEvaluator = Callable[[Fabric, Float[Array, " case"], Float[Array, "case unknown"]], Evaluation]


@lru_cache(maxsize=16)
def batch_evaluator(shape: MeshShape) -> BatchEvaluator:
    """Compiled :func:`evaluate` for a batch of fabrics stacked along their first axis."""
    return jax.jit(jax.vmap(lambda *case: evaluate(network(shape), *case)))
