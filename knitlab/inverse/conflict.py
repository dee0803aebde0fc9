"""Conflict: two targets of a design that cannot be met together."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.inverse.design import Designed
from knitlab.inverse.objective import scale_of

NOTICED = 0.25
"""Trade-off between two targets, in tolerances, above which they conflict."""


@dataclass(frozen=True)
class Conflict:
    """Two targets of which no trial meets both.

    Attributes:
        labels: names of the targets.
        off_by: distances of the converged trials, each over the tolerance of its target.
        candidates: for each trial the number of the candidate whose search it belongs to.
    """

    labels: tuple[str, str]
    off_by: Float[np.ndarray, "trial 2"]
    candidates: pd.Series


def conflict_of(designed: Designed) -> Conflict | None:
    """The two targets or constraints that conflict most, if any.

    Args:
        designed: a finished design.
    """
    wanted = [*designed.request.targets, *designed.request.subject_to]
    trials = designed.trials[designed.trials["distance"].notna()]
    scaled = np.array(
        [
            trials[f"off_by_{number}"].to_numpy(float) / scale_of(target)
            for number, target in enumerate(wanted, start=1)
        ]
    )
    best, furthest = None, 1.0
    for one, other in combinations(range(len(wanted)), 2):
        joint = float(np.maximum(scaled[one], scaled[other]).min(initial=np.inf))
        if joint > furthest and _are_conflicting(scaled[one], scaled[other]):
            best, furthest = (one, other), joint
    if best is None:
        return None
    labels = wanted[best[0]].text, wanted[best[1]].text
    return Conflict(labels, scaled[list(best)].T, trials["candidate"].reset_index(drop=True))


def _are_conflicting(one: Float[np.ndarray, " trial"], other: Float[np.ndarray, " trial"]) -> bool:
    """Whether the trial nearest to either target is further from the other than the best trial."""
    lost = one[np.argmin(other)] - one.min(), other[np.argmin(one)] - other.min()
    return min(lost) > NOTICED
