"""Checks of claims that every sample must satisfy on its own; the worst sample decides.

Each is a function of a cube at one value of every swept setting. Its other arguments are the keys
of a claim in ``params/claims.toml``: ``about`` selects the samples, ``of`` names the variable.
Samples without a complete test are ignored; NotMeasured if too few are left.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from pydantic import PositiveFloat

from knitlab.validation.margin import CheckResult, Labels, NotMeasured, above, below, within, worst
from knitlab.validation.samples import About, Checkerboards, PureStripes, Samples, name_of, unit_of

MOST_LISTED = 9  # largest number of samples, or steps between them, whose values are listed
FEWEST_POINTS = 3  # fewest applied strains, or cells along a sample, for a curve
Measured = tuple[float | None, str]  # margin of one sample, and the measured value as text
Measure = Callable[[xr.Dataset], Measured]


def value_within(
    cube: xr.Dataset,
    about: Checkerboards,
    of: str,
    lowest: float = -np.inf,
    highest: float = np.inf,
    slack: float = 0.0,
) -> CheckResult:
    """A value, or a curve over the applied strain, is between two limits, with some slack.

    A value equal to a limit of 0 is outside.
    """

    def measure(sample: xr.Dataset) -> Measured:
        values = sample[of].values[np.isfinite(sample[of].values)]
        if not values.size:
            return None, ""
        least, most = float(values.min()), float(values.max())
        margin = worst(within(end, lowest - slack, highest + slack) for end in (least, most))
        return margin, f"{least:.2f} to {most:.2f}" if sample[of].ndim else f"{least:.3g}"

    return _each(cube, about, measure, of)


def less_than(cube: xr.Dataset, about: Checkerboards, of: str, than: str) -> CheckResult:
    """The value ``of`` is less than the value ``than`` of the same sample."""

    def measure(sample: xr.Dataset) -> Measured:
        one, other = float(sample[of]), float(sample[than])
        return below(one, other, strict=True), f"{one:.3g} to {other:.3g}{unit_of(of)}"

    return _each(cube, about, measure, of, than)


def rises_and_falls(
    cube: xr.Dataset, about: Checkerboards, of: str, fall: PositiveFloat
) -> CheckResult:
    """A curve rises to a peak within the test, then falls by the fraction ``fall`` of the peak."""

    def measure(sample: xr.Dataset) -> Measured:
        curve = sample[of].dropna("applied_strain")
        if curve.size < FEWEST_POINTS:
            return None, ""
        top = int(curve.values.argmax())
        first, peak, last = curve.values[[0, top, -1]].tolist()
        falls = (peak - last) / peak if peak > max(first, 0.0) else 0.0
        strain = float(curve["applied_strain"][top])
        return above(falls, fall), f"peak {peak:.3f} at {strain:.0%}, then {-falls:+.0%}"

    return _each(cube, about, measure, of)


def follows(
    cube: xr.Dataset, about: Checkerboards, of: str, tolerance: PositiveFloat
) -> CheckResult:
    """A strain rises with the applied strain and stays close to it.

    ``tolerance`` is of the largest departure, over the largest applied strain.
    """

    def measure(sample: xr.Dataset) -> Measured:
        curve = sample[of].dropna("applied_strain")
        if curve.size < FEWEST_POINTS:
            return None, ""
        applied = curve["applied_strain"]
        off = float(abs(curve - applied).max() / applied.max())
        slope = float((np.diff(curve) / np.diff(applied)).min())
        margin = worst([below(off, tolerance), above(slope, 0, strict=True)])
        return margin, f"off by {off:.1%}" + ("" if slope > 0 else ", not monotonic")

    return _each(cube, about, measure, of)


def largest_at_centre(
    cube: xr.Dataset, about: Checkerboards, of: str, applied_strain: PositiveFloat
) -> CheckResult:
    """A local strain is positive at the centre, and larger there than along the rest."""
    # JAX is imported only for this check.
    from knitlab.measure.unit_cells import central

    def measure(sample: xr.Dataset) -> Measured:
        if not np.isclose(sample["applied_strain"], applied_strain, 0, 1e-9).any():
            raise NotMeasured(f"no applied strain of {applied_strain:g} in this cube")
        field = sample[of].sel(applied_strain=applied_strain, method="nearest")
        along = field.dropna("cell_y", how="all").mean("cell_x").values
        if along.size < FEWEST_POINTS:
            return None, ""
        middle = central(along.size)
        centre, beside = along[middle].max(), np.delete(along, middle).max()
        scale = float(abs(along).max())
        positive = above(along[middle].min(), 0, strict=True, scale=scale)
        margin = worst([positive, above(centre, beside, scale=scale)])
        return margin, f"{centre:.3f} in the central cells, {beside:.3f} beside them"

    return _each(cube, about, measure, of)


def stripe_toe(
    cube: xr.Dataset, about: PureStripes, softer_than: PositiveFloat, visible: bool
) -> CheckResult:
    """A force curve is J-shaped or not: its initial over its largest tangent is small."""

    def measure(sample: xr.Dataset) -> Measured:
        slopes = tangents(sample)
        ratio = float(slopes[0] / slopes.max())
        j_shaped = below(ratio, softer_than, strict=True)
        return j_shaped if visible else above(ratio, softer_than), f"{ratio:.2f}"

    return _each(cube, about, measure, "row_force")


def same_curves(
    cube: xr.Dataset, about: PureStripes, one: str, other: str, tolerance: PositiveFloat
) -> CheckResult:
    """Two curves of a stripe differ by at most ``tolerance`` times the largest of ``other``."""

    def measure(sample: xr.Dataset) -> Measured:
        reference = sample[other].values
        off = float(abs(sample[one].values - reference).max() / abs(reference).max())
        return below(off, tolerance), f"{off:.1%}"

    return _each(cube, about, measure, one, other)


def tangents(stripe: xr.Dataset) -> np.ndarray:
    """Slopes of force against applied strain, between the applied strains of a stripe [N]."""
    return np.diff(stripe["row_force"].values) / np.diff(stripe["applied_strain"].values)


def _each(cube: xr.Dataset, about: About, measure: Measure, *variables: str) -> CheckResult:
    samples = Samples.of(cube, about, *variables)
    margins, texts = dict[Labels, float](), dict[Labels, str]()
    for labels, sample in samples.complete.items():
        margin, text = measure(sample)
        if margin is not None:
            margins[labels], texts[labels] = margin, f"{name_of(labels)} {text}"
    if not margins:
        raise samples.too_few(0)
    failing = [labels for labels, margin in margins.items() if margin < 0]
    opening = f"{len(failing)} of {len(margins)} do not: " if failing else ""
    shown = failing or list(margins)
    first = sorted(shown, key=lambda labels: margins[labels])[:MOST_LISTED]
    listed = ", ".join(texts[labels] for labels in shown if labels in first)
    more = f" and {len(shown) - len(first)} more" if len(shown) > len(first) else ""
    return samples.result(min(margins.values()), opening + listed + more, margins)
