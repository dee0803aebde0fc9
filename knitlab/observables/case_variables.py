"""The variables of a case, and the coordinates that are the same for every case. Imports no JAX."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from knitlab.observables.observable import Variable
from knitlab.observables.schema import VARIABLES
from knitlab.observables.wavelength import POINTS
from knitlab.solvers.case import Case

STRIPE_PARAMETERS = {
    f"{knit}_{name}": (side, name)
    for knit, side in (("rib", "weft"), ("garter", "warp"))
    for name in ("k_s", "k_t", "theta_0", "period")
}
"""Stripe and attribute of each parameter in a :class:`~knitlab.model.stripe.StripePair`, by its
name. The periods of rib and garter are the paper's w and h."""
FIXED_COORDINATES: dict[str, list[Any]] = {
    "stripe_parameter": list(STRIPE_PARAMETERS),
    "boundary_point": np.linspace(0, 1, POINTS).tolist(),
}
"""Labels along dimensions that are the same for every case."""


def fixed_coordinates(dims: Iterable[str]) -> dict[str, list[Any]]:
    """The :data:`FIXED_COORDINATES` of some dimensions."""
    return {name: labels for name, labels in FIXED_COORDINATES.items() if name in dims}


def variables_of(case: Case) -> dict[str, Variable]:
    """The variables that the file of a case has."""
    return {
        name: variable
        for name, variable in VARIABLES.items()
        if variable.group.has is not None and variable.group.has(case)
    }
