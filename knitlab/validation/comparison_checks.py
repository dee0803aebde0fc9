"""Tests of claims that compare samples: trends, the lowest of all, spreads, orders, correlations.

Their arguments, results and exceptions are as in :mod:`knitlab.validation.sample_checks`.
"""

from collections.abc import Sequence
from itertools import pairwise, product
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt
from scipy import stats

from knitlab.cube.cube_file import base_dims
from knitlab.cube.schema import DESIGN_DIMS, Status
from knitlab.validation.finding import Finding, Labels, NotMeasured
from knitlab.validation.judged_samples import preference
from knitlab.validation.margin import above, below, worst
from knitlab.validation.sample_checks import MOST_LISTED, tangents
from knitlab.validation.samples import (
    Checkerboards,
    Design,
    PureStripes,
    Samples,
    checkerboards,
    name_of,
    stripes,
    unit_of,
)

Direction = Literal["rises", "falls"]
Part = Annotated[float, Field(gt=0, lt=1)]
Sample = Annotated[tuple[PositiveInt | Literal["rib", "garter"], PositiveInt], Field(strict=False)]
SampleList = Annotated[tuple[Sample, ...], Field(min_length=1, strict=False)]


def monotonic(
    cube: xr.Dataset,
    about: Checkerboards,
    of: str,
    along: Literal["n_stripe", "n_subunit"],
    direction: Direction,
) -> Finding:
    """A value, or the largest of a curve, rises or falls along n_stripe or n_subunit."""
    samples = checkerboards(cube, about, of)
    values = samples.values(lambda sample: float(sample[of].max()))
    return _trend(samples, values, DESIGN_DIMS.index(along), direction)


def stripe_order(
    cube: xr.Dataset,
    about: PureStripes,
    of: Literal["initial_tangent", "stiffening_strain"],
    direction: Direction,
    stiffened: Part = 0.5,
) -> Finding:
    """A quantity of the force curves rises or falls with the stitches across the stripe.

    It is the initial slope, or the applied strain at which the slope first reaches the fraction
    ``stiffened`` of the largest.
    """

    def value(stripe: xr.Dataset) -> float:
        slopes = tangents(stripe)
        if of == "initial_tangent":
            return float(slopes[0])
        first = int(np.argmax(slopes >= stiffened * slopes.max()))
        return float(stripe["applied_strain"].values[first : first + 2].mean())

    samples = stripes(cube, about, "row_force")
    return _trend(samples, samples.values(value), 1, direction)


def _trend(
    samples: Samples, values: dict[Labels, float], place: int, direction: Direction
) -> Finding:
    """The finding for a value that should rise or fall with one of the labels."""

    def others(labels: Labels) -> Labels:
        return (*labels[:place], *labels[place + 1 :])

    ordered = sorted(values, key=lambda labels: (others(labels), labels[place]))
    steps = [each for each in pairwise(ordered) if others(each[0]) == others(each[1])]
    if not steps:
        raise samples.too_few(len(values))
    sign = 1 if direction == "rises" else -1
    spread = float(np.ptp([*values.values()]))
    margins = {
        (one, next_): above(sign * (values[next_] - values[one]), 0, strict=True, scale=spread)
        for one, next_ in steps
    }
    wrong = [step for step, margin in margins.items() if margin is not None and margin < 0]
    text = f"all {len(steps)} steps between {len(values)} {samples.counted}"
    if wrong:
        text = f"{len(wrong)} of {len(steps)} steps do not: " + ", ".join(
            f"{name_of(one)} to {name_of(next_)}: {values[one]:.3g} to {values[next_]:.3g}"
            for one, next_ in wrong[:MOST_LISTED]
        )
    elif len(values) <= MOST_LISTED:
        text += ": " + ", ".join(f"{name_of(each)} {values[each]:.3g}" for each in ordered)
    return _compared(samples, values, worst(margins.values()), text)


def lowest_of_all(cube: xr.Dataset, about: Checkerboards, of: str, design: Design) -> Finding:
    """A design has the lowest value of all designs with a complete test."""
    samples = checkerboards(cube, about, of)
    values = samples.values(lambda sample: float(sample[of]))
    if design not in values:
        raise samples.too_few(0)
    if len(values) < 2:
        raise samples.too_few(len(values))
    next_to = min((each for each in values if each != design), key=lambda each: values[each])
    spread = float(np.ptp([*values.values()]))
    margin = above(values[next_to] - values[design], 0, strict=True, scale=spread)
    text = f"{design} {values[design]:.3f}, lowest of the others {next_to} {values[next_to]:.3f}"
    return _compared(samples, values, margin, text)


def spread(cube: xr.Dataset, about: Checkerboards, of: str, least: PositiveFloat) -> Finding:
    """The largest value exceeds the smallest by more than the fraction ``least`` of it."""
    samples = checkerboards(cube, about, of)
    values = samples.values(lambda sample: float(sample[of]))
    if len(values) < 2:
        raise samples.too_few(len(values))
    smallest, largest = min(values.values()), max(values.values())
    scale = least * abs(smallest)
    margin = above(largest, smallest + scale, strict=True, scale=scale)
    text = f"{smallest:.3g} to {largest:.3g}{unit_of(of)} over {len(values)} designs"
    return _compared(samples, values, margin, text)


def trades_off(
    cube: xr.Dataset,
    about: Checkerboards,
    of: str,
    against: str,
    significant: Annotated[float, Field(gt=0, lt=0.5)],
) -> Finding:
    """Two values of designs are anticorrelated, by Spearman's rank correlation.

    The correlation must be significant at the level ``significant``.
    """
    samples = checkerboards(cube, about, of, against)
    ones = samples.values(lambda sample: float(sample[of]))
    others = samples.values(lambda sample: float(sample[against]))
    pairs = {labels: (ones[labels], others[labels]) for labels in ones if labels in others}
    if len(pairs) < 3 or not np.ptp(list(pairs.values()), axis=0).all():
        raise samples.too_few(len(pairs))
    found = stats.spearmanr(list(pairs.values()))
    margin = below(found.statistic, -weakest_significant(len(pairs), significant))
    text = f"rank correlation {found.statistic:+.2f} over {len(pairs)} designs"
    return _compared(samples, pairs, margin, f"{text} (p = {found.pvalue:.2g})")


def weakest_significant(count: int, significant: float) -> float:
    """The weakest rank correlation that is significant, by Student's t.

    Args:
        count: number of pairs, at least 3.
        significant: two-sided significance level.
    """
    t = float(stats.t.ppf(1 - significant / 2, count - 2))
    return t / float(np.sqrt(count - 2 + t**2))


def _compared(
    samples: Samples,
    values: dict[Labels, float] | dict[Labels, tuple[float, float]],
    margin: float | None,
    text: str,
) -> Finding:
    return Finding(margin, text, len(values), samples.wanted, samples.counted, tuple(values))


def sample_order(
    cubes: Sequence[xr.Dataset], of: str, less: SampleList, more: SampleList
) -> Finding:
    """A value is lower for each of some checkerboards and stripes than for each of others.

    Samples are named as (n_stripe, n_subunit) or (knit, n), and may be in different cubes. If
    several cubes have a sample, the one whose sample is nearest the paper's is used.
    """
    found: dict[Sample, tuple[int, Labels]] = {}
    values = [_values(cube, of) for cube in cubes]
    for sample in (*less, *more):
        places = [
            (number, labels)
            for number, each in enumerate(values)
            for labels in each
            if labels[:2] == sample
        ]
        if places:
            found[sample] = min(places, key=lambda each: preference(cubes[each[0]], [each[1]]))
    if not found:
        raise NotMeasured(f"no {of} of these samples in this cube")
    value = {sample: values[number][labels] for sample, (number, labels) in found.items()}
    text = ", ".join(f"{name_of(each)} {value[each]:.3g}{unit_of(of)}" for each in found)
    wanted = len({*less, *more})
    pairs = [(one, other) for one, other in product(less, more) if {one, other} <= set(found)]
    if not pairs:
        raise NotMeasured(f"{text}; nothing to compare it with", wanted, "samples")
    margin = worst(below(value[one], value[other], strict=True) for one, other in pairs)
    numbers, at = zip(*found.values(), strict=True)
    return Finding(margin, text, len(found), wanted, "samples", at, numbers)


def _values(cube: xr.Dataset, of: str) -> dict[Labels, float]:
    """The values of all samples with a complete test."""
    if of not in cube:
        return {}
    kept = cube[of].where(cube["status"] == Status.ok)
    labels = product(*(cube[dim].values.tolist() for dim in base_dims(cube)))
    values = dict(zip(labels, kept.values.ravel().tolist(), strict=True))
    return {each: value for each, value in values.items() if np.isfinite(value)}
