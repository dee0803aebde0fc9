"""Quantities of a tensile test as pure JAX, and their sensitivities to the stripe parameters."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.stripe import StripePair
from knitlab.measure.cell_grid import CellGrid
from knitlab.measure.corners import unit_cell_corners
from knitlab.measure.strain import central_mean, local_strain, mean_cell_size, poisson_ratio

Quantity = Callable[[Configuration, Configuration, Fabric], Float[Array, ""]]
"""A function of the relaxed configuration, the strained one and the fabric."""


def quantities(shape: MeshShape, cells: CellGrid) -> dict[str, Quantity]:
    """Quantities of the shapes in a tensile test, each by its name in the cube.

    Args:
        shape: the mesh shape.
        cells: the unit cells.
    """

    def corners(configuration: Configuration) -> Float[Array, "corner_y corner_x 2"]:
        return jnp.asarray(unit_cell_corners(shape, cells, configuration))

    def strains(relaxed: Configuration, strained: Configuration) -> list[Array]:
        local = local_strain(corners(relaxed), corners(strained))
        return [jnp.asarray(central_mean(strain)) for strain in local]

    def cell(relaxed: Configuration) -> Float[Array, "2"]:
        return jnp.stack(mean_cell_size(corners(relaxed)))

    return {
        "mean_strain_xx": lambda q0, q, fabric: strains(q0, q)[0],
        "mean_strain_yy": lambda q0, q, fabric: strains(q0, q)[1],
        "poisson_ratio": lambda q0, q, fabric: jnp.asarray(poisson_ratio(*strains(q0, q))),
        "relaxed_cell_x": lambda q0, q, fabric: cell(q0)[0],
        "relaxed_cell_y": lambda q0, q, fabric: cell(q0)[1],
    }


def logarithmic(derivative: StripePair, stripes: StripePair) -> Float[np.ndarray, "quantity 8"]:
    """Logarithmic derivatives p ∂J/∂p for every parameter p of :data:`STRIPE_PARAMETERS`, in order.

    They are the change of J for a relative change of p, and thus comparable between parameters. In
    a graded fabric p changes by the same factor in all stripes of a knit.

    Args:
        derivative: derivatives of every quantity J with respect to each parameter.
        stripes: the parameters.
    """

    def by_log_of(by_number: Array, number: Array) -> Float[np.ndarray, " quantity"]:
        per_stripe = np.asarray(by_number) * np.asarray(number)[..., None]
        return per_stripe.reshape(-1, per_stripe.shape[-1]).sum(axis=0)

    by_log = jax.tree.map(by_log_of, derivative, stripes)
    return np.stack(
        [getattr(getattr(by_log, side), name) for side, name in STRIPE_PARAMETERS.values()], axis=-1
    )


STRIPE_PARAMETERS = {
    f"{knit}_{name}": (side, name)
    for knit, side in (("rib", "weft"), ("garter", "warp"))
    for name in ("k_s", "k_t", "theta_0", "period")
}
"""Stripe and attribute of each parameter in a :class:`~knitlab.fabric.stripe.StripePair`, by its
name. The periods of rib and garter are the paper's w and h."""
