"""Evaluation: energy, forces and element Hessians of a fabric at a stage of its way to the whole.

How far a fabric is folded and how hard its walls are enter as numbers, so that a path on which
they rise compiles nothing anew.
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.mechanics.element_stiffness import hinge_stiffness, spring_stiffness, wall_stiffness
from knitlab.model.configuration import Configuration
from knitlab.model.energy import Energy, element_vectors, energy
from knitlab.model.fabric import Fabric
from knitlab.model.network import Network


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


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Evaluation:
    """What a configuration costs, and how that changes.

    Attributes:
        energy: its parts [N mm].
        gradient: ∂V/∂(unknowns), minus the force on every one of them [N].
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
    net: Network, fabric: Fabric, stage: Stage, unknowns: Float[Array, " unknown"]
) -> Evaluation:
    """Energy and gradient of one fabric in one configuration.

    Args:
        net: the network of the fabric's mesh shape.
        fabric: its numbers.
        stage: how much of it acts.
        unknowns: the configuration, flattened [mm].
    """
    acting = staged(fabric, stage)

    def total(q: Float[Array, " unknown"]) -> tuple[Array, Energy]:
        parts = energy(net, acting, Configuration.of(q, net.shape))
        return parts.total, parts

    gradient, parts = jax.grad(total, has_aux=True)(unknowns)
    return Evaluation(parts, gradient)


def element_hessians(
    net: Network, fabric: Fabric, stage: Stage, unknowns: Float[Array, " unknown"]
) -> ElementHessians:
    """Element Hessians of one fabric in one configuration; arguments as for :func:`evaluate`."""
    acting, configuration = staged(fabric, stage), Configuration.of(unknowns, net.shape)
    springs = element_vectors(net.springs, configuration)[0]
    hinges = element_vectors(net.hinges, configuration)
    heights = jnp.asarray(configuration.positions[..., 2]).ravel()
    return ElementHessians(
        spring_stiffness(springs, acting.rest_length, acting.stretch_stiffness, acting.spring_law),
        hinge_stiffness(hinges, acting.rest_fold, acting.fold_stiffness, acting.fold_angle),
        wall_stiffness(heights, acting.z_max, acting.k_wall),
    )
