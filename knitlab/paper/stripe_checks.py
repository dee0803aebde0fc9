"""Tests of claims about pure stripes: the shape of their tension curves."""

from abc import abstractmethod
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.io.design_status import Status
from knitlab.io.schema import STRIPE_DIMS
from knitlab.paper.finding import Finding, not_measured
from knitlab.paper.margin import above, below, worst
from knitlab.paper.threshold import ClaimCheck

Stripe = tuple[str, int]
Margins = dict[Stripe, float | None]


class StripeCheck(ClaimCheck):
    """A test over the tension curves of pure stripes.

    Attributes:
        boundary: of the sheets.
        at_least: stripes that the paper has.
    """

    boundary: Literal["periodic", "clamped"] = "periodic"
    at_least: PositiveInt = 1

    def boundary_of_paper(self) -> str:
        """Boundary of the sheets that the claim is about."""
        return self.boundary

    def finding(self, cube: xr.Dataset) -> Finding:
        """What the cube says."""
        if cube["status"].dims != STRIPE_DIMS or self.boundary not in cube["boundary"]:
            return not_measured(f"no {self.boundary} pure stripes in this cube")
        status = cube["status"].sel(boundary=self.boundary)
        asked = [
            (str(knit), int(n))
            for knit in cube["knit"].values
            for n in cube["n"].values
            if int(status.sel(knit=knit, n=n)) != Status.excluded
            and self.concerns(str(knit), int(n))
        ]
        stripes = {
            (knit, n): cube.sel(boundary=self.boundary, knit=knit, n=n)
            for knit, n in asked
            if int(status.sel(knit=knit, n=n)) == Status.ok
        }
        wanted = max(self.at_least, len(asked))
        margins, figures = self.compare(stripes)
        margin = worst(margins.values())
        if margin is None:
            said = f"{len(stripes)} of {wanted} stripes measured"
            return not_measured(said, wanted, "stripes")
        failing = [stripe for stripe, its in margins.items() if its is not None and its < 0]
        listed = ", ".join(f"{knit} {n}: {figures[knit, n]}" for knit, n in failing or figures)
        return Finding(
            margin,
            f"not for {listed}" if failing else listed,
            len(figures),
            wanted,
            "stripes",
            tuple((knit, n, self.boundary) for knit, n in figures),
        )

    def concerns(self, knit: str, n: int) -> bool:
        """Whether it is about a stripe."""
        return True

    @abstractmethod
    def compare(self, stripes: Mapping[Stripe, xr.Dataset]) -> tuple[Margins, dict[Stripe, str]]:
        """The margins of stripes that have a complete test, and the figure of each."""


def initial_tangent(stripe: xr.Dataset) -> float:
    """Slope of force against applied strain at the start [N]."""
    return float(_tangents(stripe)[0])


def stiffening_strain(stripe: xr.Dataset, part: float) -> float:
    """Applied strain at which the slope first is a part of the largest [1]."""
    tangents = _tangents(stripe)
    first = int(np.argmax(tangents >= part * tangents.max()))
    strains = stripe["applied_strain"].values
    return float((strains[first] + strains[first + 1]) / 2)


def _tangents(stripe: xr.Dataset) -> np.ndarray:
    return np.diff(stripe["row_force"].values) / np.diff(stripe["applied_strain"].values)


def _finite(values: Mapping[Stripe, float]) -> dict[Stripe, float]:
    return {stripe: value for stripe, value in values.items() if np.isfinite(value)}


class StripeToe(StripeCheck):
    """Whether a curve begins much softer than it ends, as a J does.

    Attributes:
        softer_than: initial over largest tangent below which a J shows.
        visible: whether it is to show.
        smallest, largest: stitches across the stripes it is about, by knit.
    """

    test: Literal["stripe_toe"]
    softer_than: PositiveFloat
    visible: bool
    smallest: dict[str, int] = Field(default_factory=dict)
    largest: dict[str, int] = Field(default_factory=dict)

    def concerns(self, knit: str, n: int) -> bool:
        """Whether it is about a stripe."""
        return self.smallest.get(knit, n) <= n <= self.largest.get(knit, n)

    def compare(self, stripes: Mapping[Stripe, xr.Dataset]) -> tuple[Margins, dict[Stripe, str]]:
        """The margins of stripes that have a complete test, and the figure of each."""
        ratios = _finite(
            {
                place: initial_tangent(stripe) / _tangents(stripe).max()
                for place, stripe in stripes.items()
            }
        )
        margins = {
            place: below(ratio, self.softer_than, strict=True)
            if self.visible
            else above(ratio, self.softer_than)
            for place, ratio in ratios.items()
        }
        return margins, {place: f"{ratio:.2f}" for place, ratio in ratios.items()}


class StripeOrder(StripeCheck):
    """A figure of the curves rises, or falls, with the stitches across the stripe.

    Attributes:
        of: the figure.
        with_n: whether it rises or falls.
        stiffened: part of its largest slope at which a curve has stiffened.
    """

    test: Literal["stripe_order"]
    of: Literal["initial_tangent", "stiffening_strain"]
    with_n: Literal["rises", "falls"]
    stiffened: Annotated[float, Field(gt=0, lt=1)] = 0.5
    at_least: PositiveInt = 4

    def compare(self, stripes: Mapping[Stripe, xr.Dataset]) -> tuple[Margins, dict[Stripe, str]]:
        """The margin of the step to each stripe, and the figure of each."""
        values = _finite({place: self._value(stripe) for place, stripe in stripes.items()})
        spread = float(np.ptp([*values.values()])) if values else 0.0
        sign = 1 if self.with_n == "rises" else -1
        margins = {
            after: above(sign * (values[after] - values[before]), 0, strict=True, scale=spread)
            for before, after in pairwise(sorted(values))
            if before[0] == after[0]
        }
        return margins, {place: f"{value:.3g}" for place, value in values.items()}

    def _value(self, stripe: xr.Dataset) -> float:
        if self.of == "initial_tangent":
            return initial_tangent(stripe)
        return stiffening_strain(stripe, self.stiffened)


class SameCurves(StripeCheck):
    """Two curves of each stripe are the same."""

    test: Literal["same_curves"]
    one: str
    other: str
    tolerance: PositiveFloat

    def compare(self, stripes: Mapping[Stripe, xr.Dataset]) -> tuple[Margins, dict[Stripe, str]]:
        """The margins of stripes that have a complete test, and the figure of each."""
        off = _finite({place: self._departure(stripe) for place, stripe in stripes.items()})
        margins = {place: below(its, self.tolerance) for place, its in off.items()}
        return margins, {place: f"{its:.1%}" for place, its in off.items()}

    def _departure(self, stripe: xr.Dataset) -> float:
        one, other = stripe[self.one].values, stripe[self.other].values
        return float(abs(one - other).max() / abs(other).max())
