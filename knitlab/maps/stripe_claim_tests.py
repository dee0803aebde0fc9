"""Tests of claims about pure stripes: the shape of their tension curves."""

from itertools import pairwise
from typing import Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.maps.claim_tests import Finding, Verdict
from knitlab.sweep.design_status import Status
from knitlab.sweep.registry import STRIPE_DIMS
from knitlab.sweep.strict import Strict

Stripe = tuple[str, int]
STIFFENED = 0.5
"""Part of its largest tangent at which a curve has stiffened."""


class StripeTest(Strict):
    """A test over the tension curves of pure stripes.

    Attributes:
        boundary: of the sheets.
        at_least: stripes that must be measured for it to hold.
    """

    boundary: Literal["periodic", "clamped"] = "periodic"
    at_least: PositiveInt = 1

    def finding(self, cube: xr.Dataset) -> Finding:
        """What the cube says."""
        if cube["status"].dims != STRIPE_DIMS or self.boundary not in cube["boundary"]:
            return Finding(Verdict.not_measured, f"no {self.boundary} pure stripes in this cube")
        return self.judge(self._complete(cube))

    def judge(self, stripes: dict[Stripe, xr.Dataset]) -> Finding:
        """What the stripes say that have a complete test."""
        raise NotImplementedError

    def _complete(self, cube: xr.Dataset) -> dict[Stripe, xr.Dataset]:
        of = cube.sel(boundary=self.boundary)
        return {
            (str(knit), int(n)): of.sel(knit=knit, n=n)
            for knit in of["knit"].values
            for n in of["n"].values
            if int(of["status"].sel(knit=knit, n=n)) == Status.ok
        }

    def _said(self, figures: dict[Stripe, str], failing: list[Stripe]) -> Finding:
        shown = {stripe: figures[stripe] for stripe in failing} or figures
        listed = ", ".join(f"{knit} {n}: {figure}" for (knit, n), figure in shown.items())
        if failing:
            return Finding(Verdict.fails, f"not for {listed}")
        if len(figures) < self.at_least:
            said = f"only {len(figures)} of {self.at_least} stripes measured"
            return Finding(Verdict.not_measured, said)
        return Finding(Verdict.holds, listed)


def initial_tangent(stripe: xr.Dataset) -> float:
    """Slope of force against applied strain at the start [N]."""
    return float(_tangents(stripe)[0])


def stiffening_strain(stripe: xr.Dataset) -> float:
    """Applied strain at which the slope first is half the largest [1]."""
    tangents = _tangents(stripe)
    first = int(np.argmax(tangents >= STIFFENED * tangents.max()))
    strains = stripe["applied_strain"].values
    return float((strains[first] + strains[first + 1]) / 2)


def _tangents(stripe: xr.Dataset) -> np.ndarray:
    return np.diff(stripe["row_force"].values) / np.diff(stripe["applied_strain"].values)


class StripeToe(StripeTest):
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

    def judge(self, stripes: dict[Stripe, xr.Dataset]) -> Finding:
        """What the stripes say that have a complete test."""
        ratios = {
            (knit, n): initial_tangent(stripe) / _tangents(stripe).max()
            for (knit, n), stripe in stripes.items()
            if self.smallest.get(knit, n) <= n <= self.largest.get(knit, n)
        }
        failing = [
            stripe for stripe, ratio in ratios.items() if (ratio < self.softer_than) != self.visible
        ]
        return self._said({stripe: f"{ratio:.2f}" for stripe, ratio in ratios.items()}, failing)


MEASURES = {"initial_tangent": initial_tangent, "stiffening_strain": stiffening_strain}


class StripeOrder(StripeTest):
    """A figure of the curves rises, or falls, with the stitches across the stripe."""

    test: Literal["stripe_order"]
    of: Literal["initial_tangent", "stiffening_strain"]
    with_n: Literal["rises", "falls"]
    at_least: PositiveInt = 4

    def judge(self, stripes: dict[Stripe, xr.Dataset]) -> Finding:
        """What the stripes say that have a complete test."""
        values = {place: MEASURES[self.of](stripe) for place, stripe in stripes.items()}
        sign = 1 if self.with_n == "rises" else -1
        failing = []
        for knit in {knit for knit, _ in values}:
            line = sorted(n for other, n in values if other == knit)
            for before, after in pairwise(line):
                if sign * (values[knit, after] - values[knit, before]) <= 0:
                    failing.append((knit, after))
        return self._said({place: f"{value:.3g}" for place, value in values.items()}, failing)


class SameCurves(StripeTest):
    """Two curves of each stripe are the same."""

    test: Literal["same_curves"]
    one: str
    other: str
    tolerance: PositiveFloat

    def judge(self, stripes: dict[Stripe, xr.Dataset]) -> Finding:
        """What the stripes say that have a complete test."""
        off = {}
        for place, stripe in stripes.items():
            one, other = stripe[self.one].values, stripe[self.other].values
            off[place] = float(abs(one - other).max() / abs(other).max())
        failing = [place for place, its in off.items() if not its <= self.tolerance]
        return self._said({place: f"{its:.1%}" for place, its in off.items()}, failing)
