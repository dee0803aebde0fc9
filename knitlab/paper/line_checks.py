"""Tests of claims about straight lines: a value against n_subunit, for every n_stripe."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.io.design_status import Status
from knitlab.measure.linear_fit import LinearFit, common_slope_probability, linear_fit
from knitlab.paper.checks import DesignCheck
from knitlab.paper.finding import Finding, not_measured
from knitlab.paper.margin import above, below, worst

FEWEST_ON_A_LINE = 3


class LineCheck(DesignCheck):
    """A test of straight lines: a value against n_subunit for every n_stripe.

    It is judged on the n_stripe of which three designs are measured.
    """

    of: str

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        families = self.families()
        lines = {n: line for n in families if (line := self._line(cube, n)) is not None}
        if self.enough(lines):
            at = tuple((n, int(m)) for n, line in lines.items() for m in line.x)
            margin, said = self.compare(lines)
            return Finding(margin, said, len(lines), len(families), "lines", at)
        missing = ", ".join(str(n) for n in families if n not in lines)
        said = f"fewer than {FEWEST_ON_A_LINE} designs measured for n_stripe {missing}"
        return not_measured(said, len(families), "lines")

    def families(self) -> tuple[int, ...]:
        """The n_stripe that it is about."""
        return self.n_stripe or ()

    def enough(self, lines: Mapping[int, LinearFit]) -> bool:
        """Whether these lines can be compared: by default if there are two."""
        return len(lines) >= 2

    @abstractmethod
    def compare(self, lines: Mapping[int, LinearFit]) -> tuple[float | None, str]:
        """The margin of the lines, and their figures."""

    def _line(self, cube: xr.Dataset, n_stripe: int) -> LinearFit | None:
        if n_stripe not in cube["n_stripe"]:
            return None
        of = cube.sel(n_stripe=n_stripe)
        line = of[self.of].where(of["status"] == Status.ok).dropna("n_subunit")
        if line.size < FEWEST_ON_A_LINE:
            return None
        return linear_fit(line["n_subunit"].values.astype(float), line.values)


def _slopes(lines: Mapping[int, LinearFit]) -> str:
    return ", ".join(
        f"n_stripe {n}: {line.slope:.3f} ± {line.slope_halfwidth:.3f} mm a stitch"
        for n, line in lines.items()
    )


class Linear(LineCheck):
    """A value lies on a straight line against n_subunit, for every n_stripe."""

    test: Literal["linear"]
    r_squared: Annotated[float, Field(gt=0, lt=1)]

    def enough(self, lines: Mapping[int, LinearFit]) -> bool:
        """Whether there is a line at all: each is judged by itself."""
        return bool(lines)

    def scaled_numbers(self, factor: float) -> dict[str, Any]:
        """The limit with the part that it leaves unexplained multiplied by the factor."""
        return {name: 1 - factor * (1 - getattr(self, name)) for name in self.ours}

    def compare(self, lines: Mapping[int, LinearFit]) -> tuple[float | None, str]:
        """The margin of the lines, and their figures."""
        scale = 1 - self.r_squared
        margins = [above(line.r_squared, self.r_squared, scale=scale) for line in lines.values()]
        figures = ", ".join(f"n_stripe {n}: R² {line.r_squared:.4f}" for n, line in lines.items())
        return worst(margins), figures


class CommonSlope(LineCheck):
    """The slopes of several n_stripe agree."""

    test: Literal["common_slope"]
    spread: PositiveFloat

    def compare(self, lines: Mapping[int, LinearFit]) -> tuple[float | None, str]:
        """The margin of the lines, and their figures."""
        slopes = np.array([line.slope for line in lines.values()])
        spread = float(np.ptp(slopes) / abs(slopes.mean()))
        probability = common_slope_probability(list(lines.values()))
        figures = f"{_slopes(lines)}; apart by {spread:.0%}, p of one slope {probability:.2g}"
        return below(spread, self.spread), figures


class DepartsMost(LineCheck):
    """The slope of one n_stripe is farther from the others' mean than each of theirs."""

    test: Literal["departs_most"]
    departing: PositiveInt

    def families(self) -> tuple[int, ...]:
        """The n_stripe that it is about, the departing one among them."""
        return (self.departing, *(self.n_stripe or ()))

    def enough(self, lines: Mapping[int, LinearFit]) -> bool:
        """Whether there are the line of the departing n_stripe and two others."""
        return self.departing in lines and len(lines) >= 3

    def compare(self, lines: Mapping[int, LinearFit]) -> tuple[float | None, str]:
        """The margin of the lines, and their figures."""
        slopes = {n: line.slope for n, line in lines.items()}
        others = np.array([slope for n, slope in slopes.items() if n != self.departing])
        mean = float(others.mean())
        departs = abs(slopes[self.departing] - mean)
        scale = float(np.ptp([*slopes.values()]))
        margin = above(departs, float(abs(others - mean).max()), scale=scale)
        return margin, f"{_slopes(lines)}; mean of the others {mean:.3f}"
