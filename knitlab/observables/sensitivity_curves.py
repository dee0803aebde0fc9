"""Sensitivities of the results of a test to the stripe parameters."""

from typing import TYPE_CHECKING, Any

from knitlab.observables.observable import Group, derivative, observable

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest

SENSITIVITIES = Group("sensitivities", "Sensitivities", lambda case: case.sensitivities)
LOGARITHMIC = (
    "for a parameter p, p times the derivative with respect to p at fixed applied strain: "
    "the change for a relative change of p, comparable between parameters; divide by p for "
    "the derivative. Missing at zero strain, and where the state is not a stable "
    "equilibrium"
)


@observable(
    SENSITIVITIES,
    poisson_ratio_sensitivity=derivative(
        "logarithmic sensitivity of Poisson's ratio to a stripe parameter", description=LOGARITHMIC
    ),
    reaction_force_sensitivity=derivative(
        "logarithmic sensitivity of the reaction force to a stripe parameter",
        "N",
        description=LOGARITHMIC,
    ),
)
def sensitivity(test: "FinishedTest") -> dict[str, Any]:
    """Logarithmic sensitivities in the states that were reached."""
    from knitlab.observables.sensitivity import sensitivities

    return sensitivities(test.case, test.reached)
