"""Tests of claims about straight lines: a value against n_subunit, a line for each n_stripe.

Their arguments, results and exceptions are as in :mod:`knitlab.validation.sample_checks`. A line is
fitted to the designs of one n_stripe, of which at least three must have a complete test.
"""

from collections.abc import Mapping
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.measure.fit_statistics import LinearFit, common_slope_probability, linear_fit
from knitlab.validation.finding import Finding, NotMeasured
from knitlab.validation.margin import above, below, worst
from knitlab.validation.samples import Checkerboards, checkerboards

FEWEST_POINTS = 3
Families = Annotated[tuple[PositiveInt, ...], Field(min_length=1, strict=False)]
Lines = dict[int, LinearFit]


def linear(
    cube: xr.Dataset,
    n_stripe: Families,
    of: str,
    unexplained: Annotated[float, Field(gt=0, lt=1)],
) -> Finding:
    """A value is linear in n_subunit: a line leaves little of its variance unexplained."""
    lines = _lines(cube, n_stripe, of, fewest=1)
    margin = worst(
        above(line.r_squared, 1 - unexplained, scale=unexplained) for line in lines.values()
    )
    text = ", ".join(f"n_stripe {n}: R² {line.r_squared:.4f}" for n, line in lines.items())
    return _finding(lines, n_stripe, margin, text)


def common_slope(cube: xr.Dataset, n_stripe: Families, of: str, spread: PositiveFloat) -> Finding:
    """The slopes of all lines agree: they differ by at most a part ``spread`` of their mean."""
    lines = _lines(cube, n_stripe, of, fewest=2)
    slopes = np.array([line.slope for line in lines.values()])
    found = float(np.ptp(slopes) / abs(slopes.mean()))
    probability = common_slope_probability(list(lines.values()))
    text = f"{_slopes(lines)}; apart by {found:.0%}, p of one slope {probability:.2g}"
    return _finding(lines, n_stripe, below(found, spread), text)


def departs_most(cube: xr.Dataset, n_stripe: Families, of: str, departing: PositiveInt) -> Finding:
    """The slope of one n_stripe is farther from the mean of the others than each of the others."""
    lines = _lines(cube, (departing, *n_stripe), of, fewest=3, needed=departing)
    others = np.array([line.slope for n, line in lines.items() if n != departing])
    mean = float(others.mean())
    departs = abs(lines[departing].slope - mean)
    scale = float(np.ptp([line.slope for line in lines.values()]))
    margin = above(departs, float(abs(others - mean).max()), scale=scale)
    text = f"{_slopes(lines)}; mean of the others {mean:.3f}"
    return _finding(lines, (departing, *n_stripe), margin, text)


def _lines(
    cube: xr.Dataset, n_stripe: Families, of: str, fewest: int, needed: int | None = None
) -> Lines:
    """The lines of all n_stripe of which enough designs are measured.

    Raises:
        NotMeasured: if there are fewer than ``fewest``, or that of ``needed`` is missing.
    """
    samples = checkerboards(cube, Checkerboards(n_stripe=n_stripe), of)
    values = samples.values(lambda sample: float(sample[of]))
    points = {n: [(float(m), v) for (k, m), v in values.items() if k == n] for n in n_stripe}
    lines = {
        n: linear_fit(*np.array(each).T) for n, each in points.items() if len(each) >= FEWEST_POINTS
    }
    if len(lines) < fewest or (needed is not None and needed not in lines):
        missing = ", ".join(str(n) for n in n_stripe if n not in lines)
        reason = f"fewer than {FEWEST_POINTS} designs measured for n_stripe {missing}"
        raise NotMeasured(reason, len(n_stripe), "lines")
    return lines


def _finding(lines: Lines, n_stripe: Families, margin: float | None, text: str) -> Finding:
    at = tuple((n, int(m)) for n, line in lines.items() for m in line.x)
    return Finding(margin, text, len(lines), len(n_stripe), "lines", at)


def _slopes(lines: Mapping[int, LinearFit]) -> str:
    return ", ".join(
        f"n_stripe {n}: {line.slope:.3f} ± {line.slope_halfwidth:.3f} mm a stitch"
        for n, line in lines.items()
    )
