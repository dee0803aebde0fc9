"""Tests of claims that set pure stripes and checkerboards side by side, from several cubes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveInt
from scipy import stats

from knitlab.io.cube_file import base_dims
from knitlab.io.design_status import Status
from knitlab.io.schema import DESIGN_DIMS, STRIPE_DIMS
from knitlab.io.strict_model import StrictModel
from knitlab.paper.checks import Pair, unit_of
from knitlab.paper.finding import Finding, Labels, not_measured
from knitlab.paper.margin import below, worst
from knitlab.paper.sample import preference
from knitlab.paper.threshold import ClaimCheck


class StripeSample(StrictModel):
    """A pure stripe of n stitches."""

    knit: Literal["rib", "garter"]
    n: PositiveInt

    def __str__(self) -> str:
        """Its name."""
        return f"{self.n} × {self.n} {self.knit}"


Sample = StripeSample | Pair
Samples = Annotated[tuple[Sample, ...], Field(min_length=1, strict=False)]


@dataclass(frozen=True)
class Place:
    """Where a value of a sample was found.

    Attributes:
        cube: number of the cube.
        at: labels of the sample along the cube's own dimensions.
        value: what was found.
    """

    cube: int
    at: Labels
    value: float


class SampleOrder(ClaimCheck):
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
        places = self.places(cubes)
        wanted = len({str(sample) for sample in (*self.less, *self.more)})
        pairs = [
            (places[str(one)], places[str(other)])
            for one, other in product(self.less, self.more)
            if str(one) in places and str(other) in places
        ]
        unit = unit_of(self.of)
        listed = ", ".join(f"{name} {its.value:.3g}{unit}" for name, its in places.items())
        if not places:
            return not_measured(f"no {self.of} of these samples in this cube")
        if not pairs:
            return not_measured(f"{listed}; nothing to compare it with", wanted, "samples")
        return Finding(
            worst(below(one.value, other.value, strict=True) for one, other in pairs),
            listed,
            len(places),
            wanted,
            "samples",
            tuple(place.at for place in places.values()),
        )

    def places(self, cubes: Sequence[xr.Dataset]) -> dict[str, Place]:
        """Where each sample's value is taken from, by the sample's name.

        Of several cubes that have a sample, the one is taken whose sample is nearest those of the
        paper.
        """
        found = {}
        for sample in (*self.less, *self.more):
            candidates = [
                Place(number, at, value)
                for number, cube in enumerate(cubes)
                for at, value in self._values(cube, sample)
            ]
            if candidates:
                found[str(sample)] = min(
                    candidates,
                    key=lambda its: preference(cubes[its.cube], [its.at], self.paper_boundary),
                )
        return found

    def _values(self, cube: xr.Dataset, sample: Sample) -> list[tuple[Labels, float]]:
        """The values that a cube has of a sample, under every boundary, by their labels."""
        dims = base_dims(cube)
        wanted: list[Labels]
        if isinstance(sample, StripeSample) and dims == STRIPE_DIMS:
            wanted = [(sample.knit, sample.n, str(its)) for its in cube["boundary"].values]
        elif isinstance(sample, tuple) and dims == DESIGN_DIMS:
            wanted = [sample]
        else:
            wanted = []
        found = []
        for labels in wanted if self.of in cube else ():
            along = dict(zip(dims, labels, strict=True))
            if all(label in cube[dim].values for dim, label in along.items()):
                cell = cube[["status", self.of]].sel(along)
                if int(cell["status"]) == Status.ok and np.isfinite(cell[self.of]):
                    found.append((labels, float(cell[self.of])))
        return found


class TradesOff(ClaimCheck):
    """Of two figures of all designs, one is less where the other is more.

    Attributes:
        of, against: the figures.
        at_least: designs that the paper has.
        significant: chance of as strong a correlation without any, below which one counts.
    """

    test: Literal["trades_off"]
    of: str
    against: str
    at_least: PositiveInt
    significant: Annotated[float, Field(gt=0, lt=0.5)] = 0.05

    def finding(self, cube: xr.Dataset) -> Finding:
        """What the cube says, by Spearman's rank correlation."""
        if base_dims(cube) != DESIGN_DIMS or not {self.of, self.against} <= set(cube.data_vars):
            return not_measured(f"no {self.of} of checkerboards in this cube")
        kept = (
            (cube["status"] == Status.ok)
            & np.isfinite(cube[self.of])
            & np.isfinite(cube[self.against])
        ).values
        asked = int(((cube["status"] != Status.excluded) & (cube["case_id"] != "")).sum())
        one, other = cube[self.of].values[kept], cube[self.against].values[kept]
        count, wanted = len(one), max(self.at_least, asked)
        if count < 3 or not np.ptp(one) or not np.ptp(other):
            return not_measured(f"{count} of {wanted} designs measured", wanted)
        found = stats.spearmanr(one, other)
        said = f"rank correlation {found.statistic:+.2f} over {count} designs"
        return Finding(
            below(found.statistic, -weakest_significant(count, self.significant)),
            f"{said} (p = {found.pvalue:.2g})",
            count,
            wanted,
            at=tuple(
                (int(cube["n_stripe"][row]), int(cube["n_subunit"][column]))
                for row, column in np.argwhere(kept)
            ),
        )


def weakest_significant(count: int, significant: float) -> float:
    """The weakest rank correlation of so many pairs that is significant, by Student's t.

    Args:
        count: number of pairs, at least 3.
        significant: two-sided chance of as strong a correlation without any.
    """
    t = float(stats.t.ppf(1 - significant / 2, count - 2))
    return t / float(np.sqrt(count - 2 + t**2))
