"""Conflict: which two targets of a design pull apart."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.optimisation.design import Designed
from knitlab.optimisation.objective import scale_of

NOTICED = 0.25
"""Distance, in tolerances, that has to be given up for two targets to pull apart."""


@dataclass(frozen=True)
class Conflict:
    """Two targets of which no trial meets both.

    Attributes:
        labels: of the targets.
        off_by: distances of the trials that converged, each over its tolerance.
        candidates: number of the candidate whose search each trial is of.
    """

    labels: tuple[str, str]
    off_by: Float[np.ndarray, "trial 2"]
    candidates: pd.Series


def conflict_of(designed: Designed) -> Conflict | None:
    """The two targets or constraints that are the furthest from being met together, if any.

    Args:
        designed: a finished design.
    """
    wanted = [*designed.request.targets, *designed.request.subject_to]
    trials = designed.trials[designed.trials["distance"].notna()]
    scaled = np.array(
        [
            trials[f"off_by_{number}"].to_numpy(float) / scale_of(its)
            for number, its in enumerate(wanted, start=1)
        ]
    )
    best, furthest = None, 1.0
    for one, other in combinations(range(len(wanted)), 2):
        together = float(np.maximum(scaled[one], scaled[other]).min(initial=np.inf))
        if together > furthest and _pull_apart(scaled[one], scaled[other]):
            best, furthest = (one, other), together
    if best is None:
        return None
    labels = wanted[best[0]].text, wanted[best[1]].text
    return Conflict(labels, scaled[list(best)].T, trials["candidate"].reset_index(drop=True))


def _pull_apart(one: Float[np.ndarray, " trial"], other: Float[np.ndarray, " trial"]) -> bool:
    """Whether the trial that is nearest to one target is farther from the other than need be."""
    lost = one[np.argmin(other)] - one.min(), other[np.argmin(one)] - other.min()
    return min(lost) > NOTICED
