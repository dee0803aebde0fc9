"""Sensitivities of a finished test to the stripe parameters."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.equilibrium.adjoint import Adjoint
from knitlab.equilibrium.linear_response import NoDerivative
from knitlab.equilibrium.loading import drive_along, reaction_force
from knitlab.equilibrium.state import State
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import energy
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape, network
from knitlab.measure.cell_grid import CellGrid
from knitlab.measure.sensitivity import (
    STRIPE_PARAMETERS,
    logarithmic,
    quantities,
)
from knitlab.simulation.case import Case

QUANTITIES = ("poisson_ratio", "reaction_force")


@lru_cache(maxsize=16)
def measured_by(
    shape: MeshShape, cells: CellGrid, names: tuple[str, ...]
) -> Callable[[Configuration, Configuration, Fabric], Float[Array, " quantity"]]:
    """Several quantities of a tensile test at once; the same function for the same arguments.

    Args:
        shape: the mesh shape.
        cells: the unit cells.
        names: names of :func:`~knitlab.measure.sensitivity.quantities`, or ``reaction_force``.
    """

    def force(relaxed: Configuration, strained: Configuration, fabric: Fabric) -> Array:
        gradient = jax.grad(lambda q: energy(network(shape), fabric, q).total)(strained)
        drive, length = drive_along(shape, relaxed)
        return reaction_force(shape, drive, length, gradient.flattened())

    known = quantities(shape, cells) | {"reaction_force": force}
    chosen = [known[name] for name in names]
    return lambda q0, q, fabric: jnp.stack([quantity(q0, q, fabric) for quantity in chosen])


def adjoint_of(case: Case, relaxed: Configuration) -> Adjoint:
    """Derivatives along the test of a case with respect to its stripe parameters.

    Args:
        case: the case.
        relaxed: its relaxed shape.

    Raises:
        NoDerivative: if the relaxed shape is not a stable equilibrium, or if the case has contact,
            which these derivatives leave out.
    """
    if case.options.contact != "none":
        raise NoDerivative("derivatives leave out contact")
    layout = case.layout
    return Adjoint(layout, case.stripe_pair, relaxed)


def sensitivities(
    case: Case, reached: Sequence[State]
) -> dict[str, Float[np.ndarray, "strain parameter"]]:
    """Logarithmic sensitivities, by the names of the schema.

    They are missing at zero strain and where there is no derivative; those of Poisson's ratio are
    also missing if the sample has no Poisson's ratio.

    Args:
        case: the case.
        reached: its converged states, the relaxed one first.
    """
    measure = measured_by(case.mesh_shape, case.cell_grid, QUANTITIES)
    stripes = case.stripe_pair
    found = np.full((len(QUANTITIES), len(reached), len(STRIPE_PARAMETERS)), np.nan)
    relaxed, *strained = reached
    try:
        adjoint = adjoint_of(case, relaxed.configuration)
    except NoDerivative:
        strained = []
    for place, state in enumerate(strained, start=1):
        try:
            derivatives = adjoint.of_strained(
                case.applied_strain[place], state.configuration, measure
            )
        except NoDerivative:
            continue
        found[:, place] = logarithmic(derivatives, stripes)
    if case.all_corners_held:
        found[QUANTITIES.index("poisson_ratio")] = np.nan
    return {f"{name}_sensitivity": values for name, values in zip(QUANTITIES, found, strict=True)}
