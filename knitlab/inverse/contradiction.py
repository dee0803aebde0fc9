"""Contradiction: two targets that no curve can meet together, whatever the fabric."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float

from knitlab.cube.strain_window import PARTS, StrainWindow
from knitlab.cube.target import Target

WITHIN_RANGE = ("mean", "min", "max")
"""Reductions whose value lies between the lowest and the highest of the curve."""


def contradictions(targets: Sequence[Target]) -> Iterator[tuple[Target, Target]]:
    """Pairs of targets of one variable whose allowed values have nothing in common.

    Values are compared at the strains that both windows share, and those of a mean, minimum or
    maximum with the range that the other target allows over its whole window. Targets of different
    variables, and other reductions over different windows, are not compared.

    Args:
        targets: with their tolerances.

    Example:
        >>> from knitlab.cube.target import read_target
        >>> low = read_target("poisson_ratio < -0.3 @ 0.05:0.25")
        >>> high = read_target("poisson_ratio > -0.2 @ 0.2:0.4")
        >>> [other.text for _, other in contradictions([low, high])]
        ['poisson_ratio > -0.2 @ 0.2:0.4']
    """
    for one, other in combinations(targets, 2):
        if one.name == other.name and _are_contradictory(one, other):
            yield one, other


def _are_contradictory(one: Target, other: Target) -> bool:
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
    inner, outer = (target.window or StrainWindow(0, 0) for target in (reduced, curve))
    if not outer.start <= inner.start <= inner.stop <= outer.stop:
        return False
    low, high = curve.allowed(_strains(inner))
    wanted_low, wanted_high = reduced.allowed(_strains(inner))
    return bool(np.max(wanted_low) > np.max(high) or np.min(wanted_high) < np.min(low))


def _apart(one: Target, other: Target, strains: Float[np.ndarray, " point"]) -> bool:
    """Whether the allowed ranges have nothing in common at some strain."""
    (low, high), (other_low, other_high) = one.allowed(strains), other.allowed(strains)
    return bool((np.maximum(low, other_low) > np.minimum(high, other_high)).any())


def _strains(window: StrainWindow | None) -> Float[np.ndarray, " point"]:
    if window is None:
        return np.zeros(1)
    return np.linspace(window.start, window.stop, PARTS + 1)
