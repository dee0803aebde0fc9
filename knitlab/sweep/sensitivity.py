"""Sensitivities of a finished test: how its results hang on the stripe parameters."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from knitlab.measure.sensitivity import STRIPE_PARAMETERS, logarithmic, measured_by
from knitlab.mechanics.adjoint import Adjoint
from knitlab.mechanics.response import NoDerivative
from knitlab.mechanics.state import State
from knitlab.model.fabric import StripePair, laid_out
from knitlab.sweep.case import Case

QUANTITIES = ("poisson_ratio", "reaction_force")


def sensitivities(
    case: Case, reached: Sequence[State]
) -> dict[str, Float[np.ndarray, "strain parameter"]]:
    """Logarithmic sensitivities, under the registry's names.

    They are missing at zero strain and where there is no derivative, and that of Poisson's ratio
    where the sample has none.

    Args:
        case: the case.
        reached: its converged states, the relaxed one first.
    """
    measure = measured_by(case.mesh_shape, case.unit_cells, QUANTITIES)
    stripes = StripePair.of(case.weft, case.warp)
    found = np.full((len(QUANTITIES), len(reached), len(STRIPE_PARAMETERS)), np.nan)
    relaxed, *strained = reached
    try:
        weave = laid_out(case.sample, case.sheet, case.reading)
        adjoint = Adjoint(weave, stripes, relaxed.configuration)
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
    return {f"{name}_sensitivity": its for name, its in zip(QUANTITIES, found, strict=True)}
