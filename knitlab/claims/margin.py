"""Margins: how far what was measured is from the threshold of a claim, as one number without unit.

It is the distance from the value to its limit, towards the side that the claim wants, over a scale:
the limit itself, or 1 if that is 0; the spread of all values of an order; the largest strain along
a sample; what the limit of R² leaves unexplained. The worst of many designs or steps counts. Where
a claim excludes its limit, a value on it misses by the least that a number can.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

NEAR = 0.25  # a claim that fails by at most this margin is a near miss
GOOD = 0.25  # a claim that holds by at least this margin holds with a good margin
MAX_MARGIN = 1000.0  # margins beyond this, of either sign, are given as this
MIN_MISS = math.nextafter(0.0, -1.0)  # margin of a value on a limit that the claim excludes
Labels = tuple[str | int, ...]
"""Labels of one sample along the cube's dimensions: (4, 16), or ("rib", 4, "periodic")."""


class Grade(StrEnum):
    """Whether a claim holds in a cube, with near misses apart from claims that fail by more."""

    holds = "holds"
    near_miss = "near miss"
    fails = "fails"
    not_measured = "not measured"


@dataclass(frozen=True)
class CheckResult:
    """The result of the check of a claim, which was judged on some of the samples that it wants."""

    margin: float | None  # None if the claim could not be measured
    text: str  # what was measured, or what is missing
    judged: int = 0
    wanted: int = 0
    counted: str = "designs"  # the things whose number was judged and wanted
    at: tuple[Labels, ...] = ()  # labels of the samples
    cubes: tuple[int, ...] = ()  # indices of their cubes, of a check of several

    @property
    def grade(self) -> Grade:
        """Whether the claim holds, is a near miss, fails or was not measured."""
        if self.margin is None:
            return Grade.not_measured
        if self.margin >= 0:
            return Grade.holds
        return Grade.near_miss if self.margin >= -NEAR else Grade.fails

    @property
    def verdict(self) -> Grade:
        """The grade, in which a near miss fails."""
        return Grade.fails if self.grade is Grade.near_miss else self.grade

    @property
    def count(self) -> str:
        """What it was judged on: ``12 of 15 designs``; empty if on nothing."""
        return f"{self.judged} of {self.wanted} {self.counted}" if self.judged else ""

    @property
    def measured(self) -> str:
        """The text, with the number of samples if some are missing."""
        partial = self.margin is not None and self.judged < self.wanted
        return f"{self.text}; judged on {self.count}" if partial else self.text


class NotMeasured(Exception):
    """The cube has too little to check a claim; ``result`` has no margin and states why."""

    def __init__(self, reason: str, wanted: int = 0, counted: str = "designs") -> None:
        self.result = CheckResult(None, reason, 0, wanted, counted)
        super().__init__(reason)


def above(
    value: float, limit: float, *, strict: bool = False, scale: float | None = None
) -> float | None:
    """Margin of a value above a limit, by default over its size; None if one is not finite."""
    scale = (abs(limit) or 1.0) if scale is None else scale
    if not all(map(math.isfinite, (value, limit, scale))):
        return None
    distance = float(value) - float(limit)
    if distance == 0:
        return MIN_MISS if strict else 0.0
    margin = distance / float(scale) if scale > 0 else math.copysign(MAX_MARGIN, distance)
    if margin == 0 and distance < 0:
        return MIN_MISS
    return min(max(margin, -MAX_MARGIN), MAX_MARGIN)


def below(value: float, limit: float, *, strict: bool = False) -> float | None:
    """Margin of a value that must be at most a limit; otherwise as :func:`above`."""
    return above(-value, -limit, strict=strict)


def within(value: float, lowest: float, highest: float) -> float | None:
    """Margin of a value between two limits; one may be infinite, and a limit of 0 is excluded."""
    to_lowest = above(value, lowest, strict=lowest == 0)
    return worst([to_lowest, below(value, highest, strict=highest == 0)])


def worst(margins: Iterable[float | None]) -> float | None:
    """The smallest of several margins, of those there are; ``None`` if there is none."""
    return min((each for each in margins if each is not None), default=None)


def signed(margin: float | None) -> str:
    """A margin with its sign and two decimals; nothing if there is none."""
    return "" if margin is None else f"{margin:+.2f}"
