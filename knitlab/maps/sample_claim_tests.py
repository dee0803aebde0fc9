"""Tests of claims that set pure stripes and checkerboards side by side, from several cubes."""

from collections.abc import Sequence
from itertools import product
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveInt
from scipy.stats import spearmanr

from knitlab.maps.claim_tests import Finding, Pair, Verdict
from knitlab.sweep.cube_file import base_dims
from knitlab.sweep.design_status import Status
from knitlab.sweep.registry import DESIGN_DIMS, VARIABLES
from knitlab.sweep.strict import Strict


class StripeSample(Strict):
    """A pure stripe of n stitches."""

    knit: Literal["rib", "garter"]
    n: PositiveInt

    def __str__(self) -> str:
        """Its name."""
        return f"{self.n} × {self.n} {self.knit}"


Sample = StripeSample | Pair
SIGNIFICANT = 0.05
"""Chance of as strong a correlation without any, below which one counts."""
Samples = Annotated[tuple[Sample, ...], Field(min_length=1, strict=False)]


class SampleOrder(Strict):
    """One value a sample is less for each of some samples than for each of others."""

    test: Literal["sample_order"]
    of: str
    less: Samples
    more: Samples

    def finding(self, cube: xr.Dataset) -> Finding:
        """What one cube says."""
        return self.finding_among([cube])

    def finding_among(self, cubes: Sequence[xr.Dataset]) -> Finding:
        """What several cubes say, of which each may hold some of the samples."""
        values = {
            str(sample): next(
                (its for cube in cubes if np.isfinite(its := self._value(cube, sample))), np.nan
            )
            for sample in (*self.less, *self.more)
        }
        known = {name: its for name, its in values.items() if np.isfinite(its)}
        if not known:
            return Finding(Verdict.not_measured, f"no {self.of} of these samples in this cube")
        unit = VARIABLES[self.of].units
        listed = ", ".join(
            f"{name} {its:.3g}" + (f" {unit}" if unit != "1" else "") for name, its in known.items()
        )
        pairs = [(values[str(a)], values[str(b)]) for a, b in product(self.less, self.more)]
        if any(one >= other for one, other in pairs):
            return Finding(Verdict.fails, listed)
        if missing := sorted(set(values) - set(known)):
            return Finding(Verdict.not_measured, f"{listed}; none for {', '.join(missing)}")
        return Finding(Verdict.holds, listed)

    def _value(self, cube: xr.Dataset, sample: Sample) -> float:
        checkered = base_dims(cube) == DESIGN_DIMS
        if self.of not in cube or checkered == isinstance(sample, StripeSample):
            return float("nan")
        if isinstance(sample, StripeSample):
            labels = {"knit": sample.knit, "n": sample.n}
        else:
            labels = dict(zip(DESIGN_DIMS, sample, strict=True))
        if any(label not in cube[dim].values for dim, label in labels.items()):
            return float("nan")
        cells = cube[["status", self.of]].sel(labels)
        values = np.atleast_1d(cells[self.of].where(cells["status"] == Status.ok).values)
        finite = values[np.isfinite(values)]
        return float(finite[0]) if finite.size else float("nan")


class TradesOff(Strict):
    """Of two figures of all designs, one is less where the other is more."""

    test: Literal["trades_off"]
    of: str
    against: str
    at_least: PositiveInt

    def finding(self, cube: xr.Dataset) -> Finding:
        """What the cube says, by Spearman's rank correlation."""
        if base_dims(cube) != DESIGN_DIMS or not {self.of, self.against} <= set(cube.data_vars):
            return Finding(Verdict.not_measured, f"no {self.of} of checkerboards in this cube")
        kept = cube["status"].values == Status.ok
        one, other = cube[self.of].values[kept], cube[self.against].values[kept]
        both = np.isfinite(one) & np.isfinite(other)
        if both.sum() < self.at_least:
            said = f"only {both.sum()} of {self.at_least} designs measured"
            return Finding(Verdict.not_measured, said)
        found = spearmanr(one[both], other[both])
        said = (
            f"rank correlation {found.statistic:+.2f} over {both.sum()} designs"
            f" (p = {found.pvalue:.2g})"
        )
        holds = found.statistic < 0 and found.pvalue < SIGNIFICANT
        return Finding(Verdict.holds if holds else Verdict.fails, said)
