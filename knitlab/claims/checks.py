"""Checks of claims: every sample on its own, trends, extremes, orders, correlations and lines.

Each is registered by :func:`check`, or by :func:`sample_check` if it measures one sample at a time.
Its arguments are the keys of a claim in ``params/claims.toml``. NotMeasured if too few samples have
a complete test.
"""

from collections.abc import Callable, Sequence
from functools import wraps
from itertools import pairwise, product
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt
from scipy import stats

from knitlab.claims.margin import CheckResult, Labels, NotMeasured, above, below, within, worst
from knitlab.claims.samples import (
    About,
    Checkerboards,
    Design,
    PureStripes,
    Samples,
    preference,
    sample_name,
    unit_suffix,
    values_by_label,
)
from knitlab.lab.fit_statistics import LinearFit, common_slope_probability, linear_fit
from knitlab.observables.schema import DESIGN_DIMS
from knitlab.observables.status import Status

MAX_LISTED = 9  # largest number of samples, or steps between them, whose values are listed
MIN_POINTS = 3  # fewest applied strains, or cells along a sample, for a curve
Measured = tuple[float | None, str] | None  # margin of a sample, and its value; None if unknown
Measure = Callable[..., Measured]
Check = Callable[..., CheckResult]
Direction = Literal["rises", "falls"]
Fraction = Annotated[float, Field(gt=0, lt=1)]
Sample = Annotated[tuple[PositiveInt | Literal["rib", "garter"], PositiveInt], Field(strict=False)]
SampleList = Annotated[tuple[Sample, ...], Field(min_length=1, strict=False)]
# Numbers n_stripe, each with designs at several n_subunit.
Families = Annotated[tuple[PositiveInt, ...], Field(min_length=1, strict=False)]
Lines = dict[int, LinearFit]  # the line fitted to the designs of each n_stripe, against n_subunit


CHECKS: dict[str, Check] = {}  # every check, by the name that ``test`` of a claim gives


def check(test: Check) -> Check:
    """Register a check of a cube, or of several, at one value of every swept setting."""
    CHECKS[test.__name__] = test
    return test


def sample_check(*variables: str) -> Callable[[Measure], Measure]:
    """Register a check of each sample with these variables, or arguments that name them."""

    def register(measure: Measure) -> Measure:
        @wraps(measure)
        def test(cube: xr.Dataset, about: About, **arguments: object) -> CheckResult:
            needed = [str(arguments.get(name, name)) for name in variables]
            samples = Samples.of(cube, about, *needed)
            margins, texts = dict[Labels, float](), dict[Labels, str]()
            for labels, sample in samples.complete.items():
                margin, text = measure(sample, about, **arguments) or (None, "")
                if margin is not None:
                    margins[labels] = margin
                    texts[labels] = f"{sample_name(labels)} {text}"
            if not margins:
                raise samples.too_few(0)
            failing = [labels for labels, margin in margins.items() if margin < 0]
            opening = f"{len(failing)} of {len(margins)} do not: " if failing else ""
            shown = failing or list(margins)
            first = sorted(shown, key=lambda labels: margins[labels])[:MAX_LISTED]
            listed = ", ".join(texts[labels] for labels in shown if labels in first)
            more = f" and {len(shown) - len(first)} more" if len(shown) > len(first) else ""
            return samples.result(min(margins.values()), opening + listed + more, margins)

        CHECKS[measure.__name__] = test
        return measure

    return register


@check
def laboratory(cube: xr.Dataset, needs: str) -> CheckResult:
    """A comparison with measurements that are not in the paper's text."""
    raise NotMeasured(f"needs {needs}")


@sample_check("of")
def value_within(
    sample: xr.Dataset,
    about: Checkerboards,
    of: str,
    lowest: float = -np.inf,
    highest: float = np.inf,
    slack: float = 0.0,
) -> Measured:
    """A value, or a curve, is between two limits, with some slack; a limit of 0 is excluded."""
    values = sample[of].values[np.isfinite(sample[of].values)]
    if not values.size:
        return None
    least, most = float(values.min()), float(values.max())
    margin = worst(within(end, lowest - slack, highest + slack) for end in (least, most))
    return margin, f"{least:.2f} to {most:.2f}" if sample[of].ndim else f"{least:.3g}"


@sample_check("of", "than")
def less_than(sample: xr.Dataset, about: Checkerboards, of: str, than: str) -> Measured:
    """The value ``of`` is less than the value ``than`` of the same sample."""
    one, other = float(sample[of]), float(sample[than])
    return below(one, other, strict=True), f"{one:.3g} to {other:.3g}{unit_suffix(of)}"


@sample_check("of")
def rises_and_falls(
    sample: xr.Dataset, about: Checkerboards, of: str, fall: PositiveFloat
) -> Measured:
    """A curve rises to a peak within the test, then falls by the fraction ``fall`` of the peak."""
    curve = sample[of].dropna("applied_strain")
    if curve.size < MIN_POINTS:
        return None
    top = int(curve.values.argmax())
    first, peak, last = curve.values[[0, top, -1]].tolist()
    falls = (peak - last) / peak if peak > max(first, 0.0) else 0.0
    strain = float(curve["applied_strain"][top])
    return above(falls, fall), f"peak {peak:.3f} at {strain:.0%}, then {-falls:+.0%}"


@sample_check("of")
def fall_confined(
    sample: xr.Dataset,
    about: Checkerboards,
    of: str,
    end: Literal["begins", "ends"],
    at: PositiveFloat,
    part: Fraction,
    slack: PositiveFloat,
) -> Measured:
    """The fall from the peak begins, or ends, at a strain, but for a ``part`` of the fall."""
    curve = sample[of].dropna("applied_strain")
    fall = curve[int(curve.values.argmax()) :] if curve.size else curve
    fall = fall[: int(fall.values.argmin()) + 1] if fall.size else fall
    if fall.size < MIN_POINTS:
        return None
    first, last = fall.values[[0, -1]].tolist()
    done = np.maximum.accumulate((first - fall.values) / (first - last))
    wanted = part if end == "begins" else 1 - part
    strain = float(np.interp(wanted, done, fall["applied_strain"].values))
    return within(strain, at - slack, at + slack), f"{strain:.3g}"


@sample_check("of")
def follows(
    sample: xr.Dataset, about: Checkerboards, of: str, tolerance: PositiveFloat
) -> Measured:
    """A strain rises with the applied strain, within ``tolerance`` of its largest."""
    curve = sample[of].dropna("applied_strain")
    if curve.size < MIN_POINTS:
        return None
    applied = curve["applied_strain"]
    off = float(abs(curve - applied).max() / applied.max())
    slope = float((np.diff(curve) / np.diff(applied)).min())
    margin = worst([below(off, tolerance), above(slope, 0, strict=True)])
    return margin, f"off by {off:.1%}" + ("" if slope > 0 else ", not monotonic")


@sample_check("of")
def largest_at_centre(
    sample: xr.Dataset, about: Checkerboards, of: str, applied_strain: PositiveFloat
) -> Measured:
    """A local strain is positive at the centre, and larger there than along the rest."""
    # JAX is imported only for this check.
    from knitlab.model.cell_grid import central

    if not np.isclose(sample["applied_strain"], applied_strain, 0, 1e-9).any():
        raise NotMeasured(f"no applied strain of {applied_strain:g} in this cube")
    field = sample[of].sel(applied_strain=applied_strain, method="nearest")
    along = field.dropna("cell_y", how="all").mean("cell_x").values
    if along.size < MIN_POINTS:
        return None
    middle = central(along.size)
    centre, beside = along[middle].max(), np.delete(along, middle).max()
    scale = float(abs(along).max())
    positive = above(along[middle].min(), 0, strict=True, scale=scale)
    margin = worst([positive, above(centre, beside, scale=scale)])
    return margin, f"{centre:.3f} in the central cells, {beside:.3f} beside them"


@sample_check("row_force")
def stripe_toe(
    sample: xr.Dataset, about: PureStripes, softer_than: PositiveFloat, visible: bool
) -> Measured:
    """A force curve is J-shaped or not: its initial over its largest tangent is small."""
    slopes = tangents(sample)
    ratio = float(slopes[0] / slopes.max())
    j_shaped = below(ratio, softer_than, strict=True)
    return j_shaped if visible else above(ratio, softer_than), f"{ratio:.2f}"


@sample_check("one", "other")
def same_curves(
    sample: xr.Dataset, about: PureStripes, one: str, other: str, tolerance: PositiveFloat
) -> Measured:
    """Two curves of a stripe differ by at most ``tolerance`` times the largest of ``other``."""
    reference = sample[other].values
    off = float(abs(sample[one].values - reference).max() / abs(reference).max())
    return below(off, tolerance), f"{off:.1%}"


def tangents(stripe: xr.Dataset) -> np.ndarray:
    """Slopes of force against applied strain, between the applied strains of a stripe [N]."""
    return np.diff(stripe["row_force"].values) / np.diff(stripe["applied_strain"].values)


@check
def monotonic(
    cube: xr.Dataset,
    about: Checkerboards,
    of: str,
    along: Literal["n_stripe", "n_subunit"],
    direction: Direction,
) -> CheckResult:
    """A value, or the largest of a curve, rises or falls along n_stripe or n_subunit."""
    samples = Samples.of(cube, about, of)
    return _trend(samples, samples.values(of), DESIGN_DIMS.index(along), direction)


@check
def stripe_order(
    cube: xr.Dataset,
    about: PureStripes,
    of: Literal["initial_tangent", "stiffening_strain"],
    direction: Direction,
    stiffened: Fraction = 0.5,
) -> CheckResult:
    """The initial slope, or the strain at a fraction of the largest, changes with stitches."""
    samples = Samples.of(cube, about, "row_force")
    values = dict[Labels, float]()
    for labels, stripe in samples.complete.items():
        slopes = tangents(stripe)
        first = int(np.argmax(slopes >= stiffened * slopes.max()))
        strain = float(stripe["applied_strain"].values[first : first + 2].mean())
        values[labels] = float(slopes[0]) if of == "initial_tangent" else strain
    return _trend(samples, values, 1, direction)


def _trend(
    samples: Samples, values: dict[Labels, float], label: int, direction: Direction
) -> CheckResult:
    families = {each: (*each[:label], *each[label + 1 :]) for each in values}
    ordered = sorted(values, key=lambda labels: (families[labels], labels[label]))
    steps = [step for step in pairwise(ordered) if families[step[0]] == families[step[1]]]
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
        shown = [
            f"{sample_name(one)} to {sample_name(next_)}: {values[one]:.3g} to {values[next_]:.3g}"
            for one, next_ in wrong[:MAX_LISTED]
        ]
        text = f"{len(wrong)} of {len(steps)} steps do not: {', '.join(shown)}"
    elif len(values) <= MAX_LISTED:
        text += ": " + ", ".join(f"{sample_name(each)} {values[each]:.3g}" for each in ordered)
    return samples.result(worst(margins.values()), text, values)


@check
def lowest_of_all(cube: xr.Dataset, about: Checkerboards, of: str, design: Design) -> CheckResult:
    """A design has the lowest value of all designs with a complete test."""
    samples = Samples.of(cube, about, of)
    values = samples.values(of)
    if design not in values or len(values) < 2:
        raise samples.too_few(len(values) if design in values else 0)
    next_to = min((each for each in values if each != design), key=lambda each: values[each])
    spread = float(np.ptp([*values.values()]))
    margin = above(values[next_to] - values[design], 0, strict=True, scale=spread)
    text = f"{design} {values[design]:.3f}, lowest of the others {next_to} {values[next_to]:.3f}"
    return samples.result(margin, text, values)


@check
def spread(cube: xr.Dataset, about: Checkerboards, of: str, least: PositiveFloat) -> CheckResult:
    """The largest value exceeds the smallest by more than the fraction ``least`` of it."""
    samples = Samples.of(cube, about, of)
    values = samples.values(of)
    if len(values) < 2:
        raise samples.too_few(len(values))
    smallest, largest = min(values.values()), max(values.values())
    scale = least * abs(smallest)
    margin = above(largest, smallest + scale, strict=True, scale=scale)
    text = f"{smallest:.3g} to {largest:.3g}{unit_suffix(of)} over {len(values)} designs"
    return samples.result(margin, text, values)


@check
def trades_off(
    cube: xr.Dataset,
    about: Checkerboards,
    of: str,
    against: str,
    significant: Annotated[float, Field(gt=0, lt=0.5)],
) -> CheckResult:
    """Two values are anticorrelated, by a significant rank correlation of Spearman's."""
    samples = Samples.of(cube, about, of, against)
    ones, others = samples.values(of), samples.values(against)
    pairs = {labels: (ones[labels], others[labels]) for labels in ones if labels in others}
    if len(pairs) < 3 or not np.ptp(list(pairs.values()), axis=0).all():
        raise samples.too_few(len(pairs))
    rank, probability = stats.spearmanr(list(pairs.values()))
    margin = below(rank, -weakest_significant(len(pairs), significant))
    text = f"rank correlation {rank:+.2f} over {len(pairs)} designs (p = {probability:.2g})"
    return samples.result(margin, text, pairs)


def weakest_significant(count: int, significant: float) -> float:
    """The weakest rank correlation that is significant by Student's t, at a two-sided level."""
    t = float(stats.t.ppf(1 - significant / 2, count - 2))
    return t / float(np.sqrt(count - 2 + t**2))


@check
def sample_order(
    cubes: Sequence[xr.Dataset], of: str, less: SampleList, more: SampleList
) -> CheckResult:
    """A value is lower for each of some samples than for others, in the cubes like the paper's."""
    measured = {
        (number, labels): value
        for number, cube in enumerate(cubes)
        if of in cube
        for labels, value in values_by_label(cube[of].where(cube["status"] == Status.ok)).items()
        if np.isfinite(value)
    }
    used: dict[Sample, tuple[int, Labels]] = {}
    for sample in (*less, *more):
        if candidates := [each for each in measured if each[1][:2] == sample]:
            used[sample] = min(candidates, key=lambda each: preference(cubes[each[0]], [each[1]]))
    if not used:
        raise NotMeasured(f"no {of} of these samples in this cube")
    known = {sample: measured[at] for sample, at in used.items()}
    text = ", ".join(f"{sample_name(each)} {known[each]:.3g}{unit_suffix(of)}" for each in used)
    wanted = len({*less, *more})
    pairs = [(one, other) for one, other in product(less, more) if {one, other} <= set(used)]
    if not pairs:
        raise NotMeasured(f"{text}; nothing to compare it with", wanted, "samples")
    margin = worst(below(known[one], known[other], strict=True) for one, other in pairs)
    numbers, at = zip(*used.values(), strict=True)
    return CheckResult(margin, text, len(used), wanted, "samples", at, numbers)


@check
def linear(cube: xr.Dataset, n_stripe: Families, of: str, unexplained: Fraction) -> CheckResult:
    """A value is linear in n_subunit: a line leaves little of its variance unexplained."""
    lines = _lines(cube, n_stripe, of, fewest=1)
    margin = worst(
        above(line.r_squared, 1 - unexplained, scale=unexplained) for line in lines.values()
    )
    text = ", ".join(f"n_stripe {n}: R² {line.r_squared:.4f}" for n, line in lines.items())
    return _result_of_lines(lines, n_stripe, margin, text)


@check
def common_slope(
    cube: xr.Dataset, n_stripe: Families, of: str, spread: PositiveFloat
) -> CheckResult:
    """The slopes of all lines differ by at most the fraction ``spread`` of their mean."""
    lines = _lines(cube, n_stripe, of, fewest=2)
    slopes = np.array([line.slope for line in lines.values()])
    difference = float(np.ptp(slopes) / abs(slopes.mean()))
    probability = common_slope_probability(list(lines.values()))
    text = f"{_slopes(lines)}; they differ by {difference:.0%} (p = {probability:.2g})"
    return _result_of_lines(lines, n_stripe, below(difference, spread), text)


@check
def departs_most(
    cube: xr.Dataset, n_stripe: Families, of: str, departing: PositiveInt
) -> CheckResult:
    """The slope of one n_stripe is farther from the mean of the others than each of the others."""
    every = (departing, *n_stripe)
    lines = _lines(cube, every, of, fewest=3, needed=departing)
    others = np.array([line.slope for n, line in lines.items() if n != departing])
    mean = float(others.mean())
    scale = float(np.ptp([line.slope for line in lines.values()]))
    margin = above(abs(lines[departing].slope - mean), float(abs(others - mean).max()), scale=scale)
    text = f"{_slopes(lines)}; mean of the others {mean:.3f}"
    return _result_of_lines(lines, every, margin, text)


def _lines(
    cube: xr.Dataset, n_stripe: Families, of: str, fewest: int, needed: int | None = None
) -> Lines:
    values = Samples.of(cube, Checkerboards(n_stripe=n_stripe), of).values(of)
    points = {n: [(float(m), v) for (k, m), v in values.items() if k == n] for n in n_stripe}
    enough = {n: np.array(each) for n, each in points.items() if len(each) >= MIN_POINTS}
    lines = {n: linear_fit(*each.T) for n, each in enough.items()}
    if len(lines) < fewest or needed not in (None, *lines):
        missing = ", ".join(str(n) for n in n_stripe if n not in lines)
        reason = f"fewer than {MIN_POINTS} designs measured for n_stripe {missing}"
        raise NotMeasured(reason, len(n_stripe), "lines")
    return lines


def _result_of_lines(
    lines: Lines, n_stripe: Families, margin: float | None, text: str
) -> CheckResult:
    at = tuple((n, int(m)) for n, line in lines.items() for m in line.x)
    return CheckResult(margin, text, len(lines), len(n_stripe), "lines", at)


def _slopes(lines: Lines) -> str:
    return ", ".join(
        f"n_stripe {n}: {line.slope:.3f} ± {line.slope_halfwidth:.3f} mm a stitch"
        for n, line in lines.items()
    )
