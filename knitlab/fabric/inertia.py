"""Inertia and the Lagrangian: mass, kinetic energy and viscous drag of a fabric.

Units are mm, N, g and ms, in which 1 N = 1 g mm/ms².
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import energy
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape, Network
from knitlab.fabric.options import ModelOptions
from knitlab.fabric.pattern import PatchGrid
from knitlab.fabric.stripe import Stripe


class Inertia(eqx.Module):
    """Mass and drag of one fabric on its network.

    Attributes:
        node_mass: lumped mass m of a node, one value for all nodes or one for each [g].
        damping: viscous damping of a node, c [g/ms].
    """

    node_mass: Float[Array, "*grid"]
    damping: Float[Array, ""]


def inertia(
    weft: Stripe,
    warp: Stripe,
    options: ModelOptions,
    surface_density: float,
    damping_ratio: float,
) -> Inertia:
    """Inertia of a fabric of one pair of stripes: m = ρ_s (w/4)(h/4) (paper, Sec. "3D model").

    Args:
        weft: the stripe across the wales, with the tabulated period w.
        warp: the stripe across the courses, with the tabulated period h.
        options: model options; ``length_scale`` multiplies both periods.
        surface_density: ρ_s [g/mm²].
        damping_ratio: c over √(k_s m), with the smaller k_s of both stripes [1].
    """
    mass = surface_density * _side(weft, options) * _side(warp, options)
    return _damped(mass, [weft, warp], damping_ratio)


def graded_inertia(
    pattern: PatchGrid,
    weft: Sequence[Stripe],
    warp: Sequence[Stripe],
    options: ModelOptions,
    surface_density: float,
    damping_ratio: float,
) -> Inertia:
    """Inertia of a fabric of several stripes: a node has the mean mass of the cells beside it.

    Args:
        pattern: pattern of the whole fabric, with the number of the stripe of each row and column.
        weft: the rib stripes.
        warp: the garter stripes.
        options: model options.
        surface_density: ρ_s [g/mm²].
        damping_ratio: c over √(k_s m), with the smallest k_s and the mean mass [1].
    """
    width = np.array([_side(stripe, options) for stripe in weft])
    height = np.array([_side(stripe, options) for stripe in warp])
    lines = [
        _about_lines(side, options.boundary == "periodic")
        for side in (
            height[pattern.row_stripe[pattern.patch_of_row]],
            width[pattern.column_stripe[pattern.patch_of_column]],
        )
    ]
    return _damped(surface_density * np.outer(*lines), [*weft, *warp], damping_ratio)


def _damped(
    mass: Float[np.ndarray, "*grid"] | float, stripes: Sequence[Stripe], damping_ratio: float
) -> Inertia:
    softest = min(stripe.k_s for stripe in stripes)
    damping = damping_ratio * np.sqrt(softest * np.mean(mass))
    return Inertia(node_mass=jnp.asarray(mass), damping=jnp.asarray(damping))


def _side(stripe: Stripe, options: ModelOptions) -> float:
    return options.length_scale * stripe.period / options.cells_per_period


def _about_lines(side: Float[np.ndarray, " cell"], periodic: bool) -> Float[np.ndarray, " line"]:
    """Mean side of the cells before and after each grid line; at an edge, that of one cell."""
    if periodic:
        return (np.roll(side, 1) + side) / 2
    return (np.concatenate([side[:1], side]) + np.concatenate([side, side[-1:]])) / 2


def moved_mass(shape: MeshShape, inertia: Inertia) -> Configuration:
    """Mass that each unknown moves [g].

    A coordinate moves the mass of its node. L_x and L_y, which the paper does not have, move the
    images of a line of nodes, and thus the mass of this line; equilibria do not depend on it.
    """
    mass = jnp.broadcast_to(inertia.node_mass, (shape.nodes_y, shape.nodes_x))
    lines = jnp.stack([mass[:, 0].sum(), mass[0].sum()])
    return Configuration(jnp.broadcast_to(mass[..., None], (*mass.shape, 3)), lines)


def nodes_moved(shape: MeshShape) -> Configuration:
    """Number of nodes that each unknown moves, see :func:`moved_mass`."""
    lines = [float(shape.nodes_y), float(shape.nodes_x)]
    return Configuration(jnp.ones((shape.nodes_y, shape.nodes_x, 3)), jnp.array(lines))


def kinetic_energy(net: Network, inertia: Inertia, velocity: Configuration) -> Float[Array, ""]:
    """T = ½ Σ m ‖u̇‖² [N mm] (paper, nodal kinetic energy).

    Args:
        net: network of the fabric.
        inertia: its mass.
        velocity: time derivative of its configuration [mm/ms].
    """
    mass, rates = moved_mass(net.shape, inertia).flattened(), velocity.flattened()
    return jnp.asarray(0.5 * jnp.sum(mass * rates**2))


def lagrangian(
    net: Network,
    fabric: Fabric,
    inertia: Inertia,
    configuration: Configuration,
    velocity: Configuration,
) -> Float[Array, ""]:
    """L = T − V [N mm] (paper, Lagrangian of the model).

    Args:
        net: network of the fabric.
        fabric: the fabric.
        inertia: its mass.
        configuration: its shape [mm].
        velocity: time derivative of the configuration [mm/ms].
    """
    return kinetic_energy(net, inertia, velocity) - energy(net, fabric, configuration).total


def drag(net: Network, inertia: Inertia, velocity: Configuration) -> Configuration:
    """Viscous force c u̇ on every unknown, against its velocity [N] (paper, equations of motion).

    Args:
        net: network of the fabric.
        inertia: its drag.
        velocity: time derivative of its configuration [mm/ms].
    """
    return jax.tree.map(
        lambda nodes, rate: inertia.damping * nodes * rate, nodes_moved(net.shape), velocity
    )
