"""Tests of claims that compare designs: the lowest, a trend from design to design, a spread."""

from itertools import pairwise
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import PositiveFloat

from knitlab.io.schema import DESIGN_DIMS
from knitlab.paper.checks import MOST_LISTED, Design, DesignCheck, unit_of
from knitlab.paper.finding import Finding
from knitlab.paper.margin import above, worst

FEWEST = 2
"""Designs without which there is nothing to compare."""


class OrderCheck(DesignCheck):
    """A test that compares one value of each design.

    Attributes:
        of: the value, or the curve that
        reduced: it is the smallest or the largest of.
    """

    of: str
    reduced: Literal["min", "max"] | None = None

    def values(self, cube: xr.Dataset) -> tuple[dict[Design, float], int]:
        """The values of the designs that have one, and how many designs it is about."""
        cells = self.cells(cube)
        values = {
            design: value
            for design, cell in cells.items()
            if cell is not None and np.isfinite(value := self._value(cell[self.of]))
        }
        return values, self.wanted(cells)

    def _value(self, of: xr.DataArray) -> float:
        if self.reduced is None:
            return float(of)
        return float(of.max() if self.reduced == "max" else of.min())


class LowestOfAll(OrderCheck):
    """A design has the lowest value of all, of those that were measured."""

    test: Literal["lowest_of_all"]

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        everyone = self.model_copy(update={"designs": None, "n_stripe": None})
        values, wanted = everyone.values(cube)
        (design,) = self.designs or (None,)
        if design is None or design not in values:
            return self.too_few(0, wanted)
        if len(values) < FEWEST:
            return self.too_few(len(values), wanted)
        others = {other: value for other, value in values.items() if other != design}
        next_to = min(others, key=lambda other: others[other])
        return Finding(
            above(
                others[next_to] - values[design], 0, strict=True, scale=np.ptp([*values.values()])
            ),
            f"{design} {values[design]:.3f}, lowest of the others {next_to} {others[next_to]:.3f}",
            len(values),
            wanted,
            at=tuple(values),
        )


class Monotonic(OrderCheck):
    """A value rises, or falls, from design to design along n_stripe or n_subunit."""

    test: Literal["monotonic"]
    along: Literal["n_stripe", "n_subunit"]
    direction: Literal["rises", "falls"]

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        values, wanted = self.values(cube)
        place = DESIGN_DIMS.index(self.along)
        ordered = sorted(values, key=lambda design: (design[1 - place], design[place]))
        steps = [
            (before, after)
            for before, after in pairwise(ordered)
            if before[1 - place] == after[1 - place]
        ]
        if not steps:
            return self.too_few(len(values), wanted)
        sign = 1 if self.direction == "rises" else -1
        spread = np.ptp([*values.values()])
        margins = {
            (before, after): above(
                sign * (values[after] - values[before]), 0, strict=True, scale=spread
            )
            for before, after in steps
        }
        wrong = [step for step, margin in margins.items() if margin is not None and margin < 0]
        said = f"all {len(steps)} steps between {len(values)} designs"
        if wrong:
            listed = ", ".join(
                f"{before} to {after}: {values[before]:.3f} to {values[after]:.3f}"
                for before, after in wrong[:MOST_LISTED]
            )
            said = f"{len(wrong)} of {len(steps)} steps do not: {listed}"
        return Finding(worst(margins.values()), said, len(values), wanted, at=tuple(values))


class Spread(OrderCheck):
    """A value differs between designs."""

    test: Literal["spread"]
    least: PositiveFloat

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        values, wanted = self.values(cube)
        if len(values) < FEWEST:
            return self.too_few(len(values), wanted)
        smallest, largest = min(values.values()), max(values.values())
        said = f"{smallest:.3g} to {largest:.3g}{unit_of(self.of)} over {len(values)} designs"
        scale = self.least * abs(smallest)
        margin = above(largest, smallest + scale, strict=True, scale=scale)
        return Finding(margin, said, len(values), wanted, at=tuple(values))
