"""Inertia: mass and viscous drag of a fabric, in g, mm and ms, in which 1 N = 1 g mm/ms²."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.pattern import PatchGrid
from knitlab.model.settings import ModelOptions
from knitlab.model.stripe import Stripe


class Inertia(eqx.Module):
    """Lumped mass of a node, one for all or one for each [g], and its viscous damping [g/ms]."""

    node_mass: Float[Array, "*grid"]
    damping: Float[Array, ""]


def inertia(
    weft: Sequence[Stripe],
    warp: Sequence[Stripe],
    options: ModelOptions,
    surface_density: float,
    damping_ratio: float,
    graded: PatchGrid | None = None,
) -> Inertia:
    """Inertia of a fabric: m = ρ_s (w/4)(h/4) (paper, Sec. "3D model"), ρ_s in g/mm².

    ``damping_ratio`` is c over √(k_s m), with the smallest k_s and the mean mass. Each node of a
    ``graded`` pattern has the mean mass of the cells beside it.
    """
    width, height = (
        np.array([options.length_scale * of.period / options.cells_per_period for of in stripes])
        for stripes in (weft, warp)
    )
    mass = surface_density * width[0] * height[0]
    if graded is not None:
        periodic = options.boundary == "periodic"
        rows = _about_lines(height[graded.row_stripe[graded.patch_of_row]], periodic)
        columns = _about_lines(width[graded.column_stripe[graded.patch_of_column]], periodic)
        mass = surface_density * np.outer(rows, columns)
    softest = min(stripe.k_s for stripe in (*weft, *warp))
    damping = damping_ratio * np.sqrt(softest * np.mean(mass))
    return Inertia(node_mass=jnp.asarray(mass), damping=jnp.asarray(damping))


def _about_lines(side: Float[np.ndarray, " cell"], periodic: bool) -> Float[np.ndarray, " line"]:
    """Mean side of the cells before and after each grid line; at an edge, that of one cell."""
    if periodic:
        return (np.roll(side, 1) + side) / 2
    return (np.concatenate([side[:1], side]) + np.concatenate([side, side[-1:]])) / 2
