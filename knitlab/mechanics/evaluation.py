"""Evaluation: energy, forces and element Hessians of a fabric, each one JAX program.

A program is compiled once for a mesh shape. How far a fabric is folded and how hard its walls are
enter as numbers, so that a path on which they rise compiles nothing anew.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from knitlab.mechanics.element_stiffness import (
    HINGE_ENTRIES,
    LANES,
    Laned,
    hinge_stiffness,
    laned,
    laned_stiffness,
    spring_stiffness,
)
from knitlab.model.energy import Energy, element_vectors, energy, positions, wall_energy
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape, Network, network

Result = TypeVar("Result")


class Stage(eqx.Module):
    """How much of a fabric acts: a way from the flat sheet to the whole.

    Attributes:
        fold: fraction of the rest fold angles, 0 rests flat.
        wall: fraction of the stiffness of the walls.
    """

    fold: Float[Array, ""] | float = 1.0
    wall: Float[Array, ""] | float = 1.0


WHOLE = Stage()


def staged(fabric: Fabric, stage: Stage) -> Fabric:
    """The fabric at a stage."""
    return eqx.tree_at(
        lambda f: (f.rest_fold, f.k_wall),
        fabric,
        (stage.fold * fabric.rest_fold, stage.wall * fabric.k_wall),
    )


class Evaluation(eqx.Module):
    """What a configuration costs, and how that changes.

    Attributes:
        energy: its parts [N mm].
        gradient: ∂V/∂(configuration), minus the force on every unknown [N].
    """

    energy: Energy
    gradient: Float[Array, "*batch unknown"]


class ElementHessians(eqx.Module):
    """Second derivatives of the energies that the total is summed from.

    Attributes:
        springs: of every spring's energy by its vector, lower triangle [N/mm].
        hinges: of every hinge's energy by its nodes, lower triangle, in blocks of hinges as
            :func:`~knitlab.mechanics.element_stiffness.hinge_stiffness` lays them [N/mm].
        walls: of the wall penalty by every node's height [N/mm].
    """

    springs: Float[Array | np.ndarray, "*batch 6 spring"]
    hinges: Float[Array | np.ndarray, "*batch block 171 lane"]
    walls: Float[Array | np.ndarray, "*batch node"]


def evaluate(
    net: Network, fabric: Fabric, stage: Stage, configuration: Float[Array, " unknown"]
) -> Evaluation:
    """Energy and gradient of one fabric in one configuration.

    Args:
        net: the network of the fabric's mesh shape.
        fabric: its numbers.
        stage: how much of it acts.
        configuration: node coordinates, then L_x and L_y [mm].
    """
    acting = staged(fabric, stage)

    def total(q: Float[Array, " unknown"]) -> tuple[Array, Energy]:
        parts = energy(net, acting, q)
        return parts.total, parts

    gradient, parts = jax.grad(total, has_aux=True)(configuration)
    return Evaluation(parts, gradient)


def element_hessians(
    net: Network, fabric: Fabric, stage: Stage, configuration: Float[Array, " unknown"]
) -> ElementHessians:
    """Element Hessians of one fabric in one configuration; arguments as for :func:`evaluate`."""
    springs, walls = _spring_and_wall_hessians(net, fabric, stage, configuration)
    hinges = hinge_stiffness(*_hinges(net, fabric, stage, configuration))
    return ElementHessians(springs, hinges, walls)


def _spring_and_wall_hessians(
    net: Network, fabric: Fabric, stage: Stage, configuration: Float[Array, " unknown"]
) -> tuple[Float[Array, "6 spring"], Float[Array, " node"]]:
    acting = staged(fabric, stage)
    springs = spring_stiffness(
        element_vectors(net.springs, configuration)[0],
        acting.rest_length,
        acting.stretch_stiffness,
    )
    curvature = jax.vmap(jax.grad(jax.grad(wall_energy)), (0, None, None))
    return springs, curvature(positions(configuration)[:, 2], acting.z_max, acting.k_wall)


def _hinges(
    net: Network, fabric: Fabric, stage: Stage, configuration: Float[Array, " unknown"]
) -> tuple[Float[Array, "5 3 hinge"], Float[Array, " hinge"], Float[Array, " hinge"]]:
    acting = staged(fabric, stage)
    vectors = element_vectors(net.hinges, configuration)
    return vectors, acting.rest_fold, acting.fold_stiffness


PORTION = 16
"""Blocks of hinges whose stiffness is worked out in one call."""
_portion_stiffness = jax.jit(laned_stiffness)

Program = Callable[[Fabric, Stage, Float[np.ndarray, "*batch unknown"]], Result]


@lru_cache(maxsize=16)
def evaluator(shape: MeshShape) -> Program[Evaluation]:
    """Compiled :func:`evaluate` for fabrics of one mesh shape."""
    return jax.jit(partial(evaluate, network(shape)))


@lru_cache(maxsize=16)
def hessian_evaluator(shape: MeshShape) -> Program[ElementHessians]:
    """Compiled :func:`element_hessians` for fabrics of one mesh shape.

    The hinges' program takes four times as long to compile as all the others of a mesh shape. So
    it works on portions of a fixed size, the same for all shapes, and is compiled once.
    """
    net = network(shape)
    blocks = -(-len(net.hinges.nodes) // LANES)
    portions = -(-blocks // PORTION)

    @jax.jit
    def but_hinges(
        fabric: Fabric, stage: Stage, configuration: Float[Array, " unknown"]
    ) -> tuple[Float[Array, "6 spring"], Float[Array, " node"], Laned]:
        hinges = _hinges(net, fabric, stage, configuration)
        return (
            *_spring_and_wall_hessians(net, fabric, stage, configuration),
            laned(*hinges, portions * PORTION),
        )

    def evaluated(
        fabric: Fabric, stage: Stage, configuration: Float[np.ndarray, " unknown"]
    ) -> ElementHessians:
        springs, walls, laid = jax.tree.map(np.asarray, but_hinges(fabric, stage, configuration))
        hinges = np.empty((blocks, len(HINGE_ENTRIES[0]), LANES))
        for first in range(0, blocks, PORTION):
            portion = tuple(of[first : first + PORTION] for of in laid)
            part = hinges[first : first + PORTION]
            part[:] = np.asarray(_portion_stiffness(portion))[: len(part)]
        return ElementHessians(springs, hinges, walls)

    return evaluated
