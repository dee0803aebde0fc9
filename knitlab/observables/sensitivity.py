"""Sensitivities of a test to the stripe parameters, and its quantities as pure JAX."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.cell_grid import CellGrid
from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape, network
from knitlab.model.stripe_numbers import StripePair
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.observables.unit_cells import (
    central_mean,
    local_strain,
    mean_cell_size,
    poisson_ratio,
    unit_cell_corners,
)
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.adjoint import Adjoint, NoDerivative
from knitlab.solvers.equilibrium.state import State
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.loading import reaction_force

QUANTITIES = ("poisson_ratio", "reaction_force")  # quantities whose sensitivities a cube has

Pushed = Float[Array, " unknown"]
Quantity = Callable[[Configuration, Configuration, Fabric, Pushed], Float[Array, "..."]]
"""A function of the relaxed configuration, the strained one, the fabric, and the gradient of the
energy of contact in the strained one."""


def quantities(shape: MeshShape, cells: CellGrid) -> dict[str, Quantity]:
    """Quantities of a tensile test, each by its name in the cube."""

    def corners(configuration: Configuration) -> Float[Array, "corner_y corner_x 2"]:
        return jnp.asarray(unit_cell_corners(shape, cells, configuration))

    def strains(relaxed: Configuration, strained: Configuration) -> list[Array]:
        local = local_strain(corners(relaxed), corners(strained))
        return [jnp.asarray(central_mean(strain)) for strain in local]

    def cell(relaxed: Configuration) -> Float[Array, "2"]:
        return jnp.stack(mean_cell_size(corners(relaxed)))

    def force(
        relaxed: Configuration, strained: Configuration, fabric: Fabric, pushed: Pushed
    ) -> Array:
        gradient = jax.grad(lambda q: energy(network(shape), fabric, q).total)(strained)
        drive, length = WARP.drive(shape, relaxed)
        return reaction_force(shape, drive, length, gradient.flattened() + pushed)

    return {
        "mean_strain_xx": lambda q0, q, fabric, pushed: strains(q0, q)[0],
        "mean_strain_yy": lambda q0, q, fabric, pushed: strains(q0, q)[1],
        "poisson_ratio": lambda q0, q, fabric, pushed: jnp.asarray(poisson_ratio(*strains(q0, q))),
        "relaxed_cell_x": lambda q0, q, fabric, pushed: cell(q0)[0],
        "relaxed_cell_y": lambda q0, q, fabric, pushed: cell(q0)[1],
        "reaction_force": force,
    }


@lru_cache(maxsize=16)
def measured_by(shape: MeshShape, cells: CellGrid, names: tuple[str, ...]) -> Quantity:
    """Several of the :func:`quantities` at once; the same function for the same arguments."""
    known = quantities(shape, cells)
    chosen = [known[name] for name in names]
    return lambda *of: jnp.stack([quantity(*of) for quantity in chosen])


def logarithmic(derivative: StripePair, stripes: StripePair) -> Float[np.ndarray, "quantity 8"]:
    """Logarithmic derivatives p ∂J/∂p for every parameter p of :data:`STRIPE_PARAMETERS`, in order.

    In a graded fabric p changes by the same factor in all stripes of a knit.
    """

    def by_log_of(by_number: Array, number: Array) -> Float[np.ndarray, " quantity"]:
        per_stripe = np.asarray(by_number) * np.asarray(number)[..., None]
        return per_stripe.reshape(-1, per_stripe.shape[-1]).sum(axis=0)

    by_log = jax.tree.map(by_log_of, derivative, stripes)
    return np.stack(
        [getattr(getattr(by_log, side), name) for side, name in STRIPE_PARAMETERS.values()], axis=-1
    )


def adjoint_of(case: Case, relaxed: Configuration) -> Adjoint:
    """Derivatives along a test; NoDerivative if the relaxed shape is unstable."""
    return Adjoint(case.layout, case.stripe_pair, relaxed, case.contact)


def sensitivities(
    case: Case, reached: Sequence[State]
) -> dict[str, Float[np.ndarray, "strain parameter"]]:
    """Logarithmic sensitivities in converged states, the relaxed one first, by names of the schema.

    They are missing at zero strain and where there is no derivative.
    """
    measure = measured_by(case.mesh_shape, case.cell_grid, QUANTITIES)
    values = np.full((len(QUANTITIES), len(reached), len(STRIPE_PARAMETERS)), np.nan)
    relaxed, *strained = reached
    with suppress(NoDerivative):
        adjoint = adjoint_of(case, relaxed.configuration)
        for number, state in enumerate(strained, start=1):
            strain = case.applied_strain[number]
            with suppress(NoDerivative):
                derivatives = adjoint.strained_derivatives(strain, state.configuration, measure)
                values[:, number] = logarithmic(derivatives, case.stripe_pair)
    if case.all_corners_held:
        values[QUANTITIES.index("poisson_ratio")] = np.nan
    return {f"{name}_sensitivity": each for name, each in zip(QUANTITIES, values, strict=True)}
