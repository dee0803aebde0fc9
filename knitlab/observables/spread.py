"""How far results spread over the perturbed copies of a case."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from knitlab.observables.forces import reaction_force
from knitlab.observables.observable import Group, curve, number, observable
from knitlab.observables.poisson_ratio import poisson_ratio

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest

ROBUSTNESS = Group("robustness", "Spread over perturbed copies", lambda case: case.robustness > 0)
Curve = Float[np.ndarray, " strain"]
Shorter = Float[np.ndarray, " _"]
SAME_BRANCH = 1e-6  # relative difference up to which two relaxed energies are of one branch
SPREAD_RESULTS = {"poisson_ratio": poisson_ratio, "reaction_force": reaction_force}
COPIES = (
    "over the case and its perturbed copies that reached the strain. Copies are imperfect "
    "sheets with each stripe parameter changed by up to 2 %; every second clamped one "
    "begins from the other start"
)


@observable(
    ROBUSTNESS,
    poisson_ratio_low=curve("lowest Poisson's ratio of the perturbed copies", description=COPIES),
    poisson_ratio_high=curve("highest Poisson's ratio of the perturbed copies", description=COPIES),
    reaction_force_low=curve(
        "lowest reaction force of the perturbed copies", "N", description=COPIES
    ),
    reaction_force_high=curve(
        "highest reaction force of the perturbed copies", "N", description=COPIES
    ),
    siblings=curve(
        "perturbed copies that reached a strain",
        description="without the case itself",
        integer=True,
    ),
)
def spread(test: "FinishedTest") -> dict[str, Any]:
    """Lowest and highest results; a copy counts at the strains that it reached."""
    from knitlab.observables.finished_test import FinishedTest

    copies = [FinishedTest(copy.case, copy.test) for copy in test.copies]
    values: dict[str, Any] = {}
    for name, result in SPREAD_RESULTS.items():
        others = [result(copy) for copy in copies if copy.relaxed_at_all]
        low, high, count = extremes(result(test), others)
        values[f"{name}_low"] = low
        values[f"{name}_high"] = high
        values["siblings"] = count
    return values


def extremes(own: Curve, others: Sequence[Shorter]) -> tuple[Curve, Curve, Curve]:
    """Lowest and highest values at every strain, and how many others reached it."""
    rows = np.full((1 + len(others), len(own)), np.nan)
    for row, values in zip(rows, [own, *others], strict=True):
        row[: len(values)] = values[: len(row)]
    counts = np.isfinite(rows[1:]).sum(axis=0).astype(float)
    return np.fmin.reduce(rows), np.fmax.reduce(rows), counts


@observable(
    ROBUSTNESS,
    relaxed_branches=number(
        "distinct relaxed energies",
        description=(
            "of the unperturbed fabric, relaxed from its start and from the shapes of its copies"
        ),
        integer=True,
    ),
)
def relaxed_branches(test: "FinishedTest") -> float:
    """How many distinct relaxed energies the fabric and its copies lead to."""
    own = float(test.reached[0].energy.total)
    return float(branches([own, *(copy.branch_energy for copy in test.copies)]))


def branches(energies: Sequence[float]) -> int:
    """How many distinct relaxed energies there are; what did not converge is not counted."""
    ordered = np.sort([energy for energy in energies if np.isfinite(energy)])
    if not len(ordered):
        return 0
    return 1 + int(np.count_nonzero(np.diff(ordered) > SAME_BRANCH * np.abs(ordered[1:])))
