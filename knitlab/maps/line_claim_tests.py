"""Tests of claims about straight lines: a value against n_subunit, for every n_stripe."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import PositiveFloat, PositiveInt

from knitlab.maps.claim_tests import DesignTest, Finding, Verdict
from knitlab.measure.linear_fit import LinearFit, common_slope_probability, linear_fit
from knitlab.sweep.design_status import Status

FEWEST_ON_A_LINE = 3


class LineTest(DesignTest):
    """A test of straight lines: a value against n_subunit for every n_stripe."""

    of: str

    def lines(self, cube: xr.Dataset, families: tuple[int, ...]) -> dict[int, LinearFit]:
        """The line of every n_stripe of which three designs are measured."""
        found = {}
        for n_stripe in families:
            if n_stripe not in cube["n_stripe"]:
                continue
            of = cube.sel(n_stripe=n_stripe)
            line = of[self.of].where(of["status"] == Status.ok).dropna("n_subunit")
            if line.size >= FEWEST_ON_A_LINE:
                found[n_stripe] = linear_fit(line["n_subunit"].values.astype(float), line.values)
        return found


def _slopes(lines: Mapping[int, LinearFit]) -> str:
    return ", ".join(
        f"n_stripe {n}: {line.slope:.3f} ± {line.slope_halfwidth:.3f} mm a stitch"
        for n, line in lines.items()
    )


def _needs_lines(missing: list[int]) -> Finding:
    said = f"fewer than {FEWEST_ON_A_LINE} designs measured for n_stripe"
    return Finding(Verdict.not_measured, f"{said} {', '.join(map(str, missing))}")


class Linear(LineTest):
    """A value lies on a straight line against n_subunit, for every n_stripe."""

    test: Literal["linear"]
    r_squared: PositiveFloat

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        families = self.n_stripe or ()
        lines = self.lines(cube, families)
        bent = {n: line for n, line in lines.items() if line.r_squared < self.r_squared}
        figures = ", ".join(f"n_stripe {n}: R² {line.r_squared:.4f}" for n, line in lines.items())
        if bent:
            return Finding(Verdict.fails, figures)
        if missing := [n for n in families if n not in lines]:
            return _needs_lines(missing)
        return Finding(Verdict.holds, figures)


class CommonSlope(LineTest):
    """The slopes of several n_stripe agree."""

    test: Literal["common_slope"]
    spread: PositiveFloat

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        families = self.n_stripe or ()
        lines = self.lines(cube, families)
        if missing := [n for n in families if n not in lines]:
            return _needs_lines(missing)
        slopes = np.array([line.slope for line in lines.values()])
        spread = float(np.ptp(slopes) / slopes.mean())
        probability = common_slope_probability(list(lines.values()))
        figures = f"{_slopes(lines)}; apart by {spread:.0%}, p of one slope {probability:.2g}"
        return Finding(Verdict.holds if spread <= self.spread else Verdict.fails, figures)


class DepartsMost(LineTest):
    """The slope of one n_stripe is farther from the others' mean than each of theirs."""

    test: Literal["departs_most"]
    departing: PositiveInt

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        families = (self.departing, *(self.n_stripe or ()))
        lines = self.lines(cube, families)
        if missing := [n for n in families if n not in lines]:
            return _needs_lines(missing)
        slopes = {n: line.slope for n, line in lines.items()}
        mean = np.mean([slope for n, slope in slopes.items() if n != self.departing])
        most = max(slopes, key=lambda n: abs(slopes[n] - mean))
        verdict = Verdict.holds if most == self.departing else Verdict.fails
        return Finding(verdict, f"{_slopes(lines)}; mean of the others {mean:.3f}")
