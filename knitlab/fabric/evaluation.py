"""Evaluation: energy, forces and element Hessians of a fabric at a stage of a continuation.

The fractions of fold angle and wall stiffness are traced numbers, so that a continuation in them
does not recompile.
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.element_stiffness import spring_stiffness, wall_stiffness
from knitlab.fabric.energy import Energy, element_vectors, energy
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.hinge_stiffness import hinge_stiffness
from knitlab.fabric.network import Network


class Stage(eqx.Module):
    """Stage of a continuation from the flat sheet to the complete fabric.

    Attributes:
        fold: fraction of the rest fold angles; a fabric with 0 rests flat.
        wall: fraction of the stiffness of the walls.
    """

    fold: Float[Array, ""] | float = 1.0
    wall: Float[Array, ""] | float = 1.0


COMPLETE = Stage()


@dataclass(frozen=True)
class Point:
    """A configuration and a stage, at which a fabric is evaluated.

    Attributes:
        unknowns: the configuration, flattened [mm].
        stage: the stage.
    """

    unknowns: Float[np.ndarray, " unknown"]
    stage: Stage = COMPLETE


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
    """Energy and gradient of a configuration.

    Attributes:
        energy: the parts of the energy [N mm].
        gradient: ∂V/∂(unknowns), the negative force on every unknown [N].
    """

    energy: Energy
    gradient: Float[Array, "*batch unknown"]


class ElementHessians(eqx.Module):
    """Second derivatives of the energies of elements.

    Attributes:
        springs: Hessian of the energy of every spring by its vector, lower triangle [N/mm].
        hinges: Hessian of the energy of every hinge by its nodes, lower triangle, in the blocks of
            :func:`~knitlab.fabric.hinge_stiffness.hinge_stiffness` [N/mm].
        walls: second derivative of the wall penalty by the height of every node [N/mm].
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
        fabric: the fabric.
        stage: stage of the continuation.
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
