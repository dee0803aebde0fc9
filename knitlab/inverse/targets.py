"""Targets of a design: their tolerances, and pairs of them that cannot be met together."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.cube.strain_window import PARTS, StrainWindow
from knitlab.cube.target import Target

RELATIVE_TOLERANCE = 0.05  # default tolerance of a target, over its value
TOLERANCE_OF_ZERO = 0.01  # default tolerance of a target whose value is zero
WITHIN_RANGE = ("mean", "min", "max")  # reductions that lie between the ends of a curve's range
NOTICED = 0.25  # trade-off between two targets, in tolerances, above which they conflict


def with_tolerance(target: Target) -> Target:
    """A target with its tolerance, by default 5 % of its value, or 0.01 if that is zero."""
    if target.tolerance is not None:
        return target
    wanted = max(abs(bound) for bound in (target.low, target.high) if np.isfinite(bound))
    return replace(target, tolerance=RELATIVE_TOLERANCE * wanted or TOLERANCE_OF_ZERO)


def scale_of(target: Target) -> float:
    """Unit of the distance from a target: its tolerance, which those of a request have."""
    assert target.tolerance is not None
    return target.tolerance


def contradictions(targets: Sequence[Target]) -> Iterator[tuple[Target, Target]]:
    """Pairs of targets of one variable whose allowed values have nothing in common.

    Compared are curves where both windows are, equal reductions over equal windows, and a mean,
    minimum or maximum with the range allowed by a curve over its window.
    """
    for one, other in combinations(targets, 2):
        if one.name == other.name and _contradict(one, other):
            yield one, other


def _contradict(one: Target, other: Target) -> bool:
    if one.reduction == other.reduction and one.window == other.window:
        return _apart(one, other, _strains(one.window))
    if one.window is None or other.window is None:
        return False
    if one.reduction is None and other.reduction is None:
        start = max(one.window.start, other.window.start)
        stop = min(one.window.stop, other.window.stop)
        return start <= stop and _apart(one, other, _strains(StrainWindow(start, stop)))
    curve, reduced = (one, other) if one.reduction is None else (other, one)
    if curve.reduction is not None or reduced.reduction not in WITHIN_RANGE:
        return False
    strains, shared = _strains(reduced.window), _strains(curve.window)
    if not shared[0] <= strains[0] <= strains[-1] <= shared[-1]:
        return False
    low, high = curve.allowed(strains)
    wanted_low, wanted_high = reduced.allowed(strains)
    return bool(np.max(wanted_low) > np.max(high) or np.min(wanted_high) < np.min(low))


def _apart(one: Target, other: Target, strains: Float[np.ndarray, " point"]) -> bool:
    """Whether the allowed ranges have nothing in common at some strain."""
    (low, high), (other_low, other_high) = one.allowed(strains), other.allowed(strains)
    return bool((np.maximum(low, other_low) > np.minimum(high, other_high)).any())


def _strains(window: StrainWindow | None) -> Float[np.ndarray, " point"]:
    window = window or StrainWindow(0, 0)
    return np.linspace(window.start, window.stop, PARTS + 1)


class Conflict(NamedTuple):
    """Two targets of which no trial meets both."""

    targets: tuple[str, str]
    distances: Float[np.ndarray, "trial 2"]  # over the tolerance of each
    candidates: pd.Series  # number of the search of each trial


def conflict_of(wanted: Sequence[Target], trials: pd.DataFrame) -> Conflict | None:
    """The two targets or constraints that conflict most in the trials of a design, if any do."""
    trials = trials[trials["distance"].notna()]
    scaled = [
        trials[f"off_by_{number}"].to_numpy(float) / scale_of(target)
        for number, target in enumerate(wanted, start=1)
    ]
    joint = {
        (one, other): float(np.maximum(scaled[one], scaled[other]).min())
        for one, other in combinations(range(len(wanted)), 2)
        if _compete(scaled[one], scaled[other])
    }
    if not joint or max(joint.values()) <= 1:
        return None
    one, other = max(joint, key=lambda pair: joint[pair])
    return Conflict(
        (wanted[one].text, wanted[other].text),
        np.stack([scaled[one], scaled[other]], axis=1),
        trials["candidate"].reset_index(drop=True),
    )


def _compete(one: Float[np.ndarray, " trial"], other: Float[np.ndarray, " trial"]) -> bool:
    """Whether the trial nearest to either target is further from the other than the best trial."""
    lost = one[np.argmin(other)] - one.min(), other[np.argmin(one)] - other.min()
    return min(lost) > NOTICED
