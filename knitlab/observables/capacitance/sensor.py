"""Figures of merit of a capacitor as a strain sensor (paper, "Knit capacitors").

All follow from a curve C(ε), simulated or measured. Imports neither JAX nor SciPy.
"""

from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float

CENTRAL_PART = 0.2  # central fraction of the strain range over which the paper averages the slope
RESOLUTION = 200  # number of intervals of a strain range in the search for a window
MIN_POINTS = 3
HUMIDITY = 0.05  # change of permittivity that ``humidity_strain`` refers to

Curve = Float[np.ndarray, " point"]
Kept = Bool[np.ndarray, " point"]


class CapacitorStatus(IntEnum):
    """Whether a capacitance is measured, or why not.

    ``touching``: bare electrodes are closer than ``clearance``, or electrodes pass through each
    other. ``folded_through``: a fold at the electrodes is beyond half a turn, or an electrode
    passes through itself. ``unresolved``: finer panels change the capacitance by more than the
    required accuracy.
    """

    measured = 0
    touching = 1
    folded_through = 2
    unresolved = 3


def sensor_values(
    strain: Curve, capacitance: Curve, least_linearity: float, leads: float = 0.0
) -> dict[str, float]:
    """Figures of merit of a sensor, by the names of the schema; none if it has too few points.

    The curve [pF] at ascending strains is interpolated by monotone cubics. Humidity changes all but
    the leads.
    """
    from scipy.interpolate import PchipInterpolator

    if len(strain) < MIN_POINTS:
        return {}
    curve = PchipInterpolator(strain, capacitance)
    start = float(strain[0])
    end = float(strain[-1])
    fine = np.linspace(start, end, RESOLUTION + 1)
    low, high, slope = widest_linear(fine, curve(fine), least_linearity)
    change = float(capacitance[-1] / capacitance[0]) - 1
    humidity = HUMIDITY * (1 - leads / float(capacitance[0]))
    return {
        "sensitivity": mean_slope(strain, capacitance),
        "gauge_factor": change / (end - start),
        "humidity_strain": humidity * (end - start) / abs(change) if change else float("inf"),
        # R² over the whole range; 0 for a constant, which does not depend on strain.
        "linearity": float(_fits(fine, curve(fine))[0][0, -1]),
        "working_range": high - low,
        "working_start": low,
        "working_slope": slope,
    }


def sensing_range(strain: Curve, capacitance: Curve, unfolded: float) -> Kept:
    """The first longest interval of strains that have a capacitance and are not ``unfolded``."""
    usable = np.isfinite(capacitance) & ~(strain > unfolded)
    runs = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]))).reshape(-1, 2)
    kept = np.zeros_like(usable)
    if len(runs):
        start, end = runs[np.argmax(runs[:, 1] - runs[:, 0])]
        kept[start:end] = True
    return kept


def mean_slope(strain: Curve, capacitance: Curve) -> float:
    """Mean |dC/dε| over the central 20 % of a strain range (paper, "capacitor testing" D) [pF]."""
    middle = (strain[0] + strain[-1]) / 2
    half = CENTRAL_PART / 2 * (strain[-1] - strain[0])
    inner = strain[(strain > middle - half) & (strain < middle + half)]
    strains = np.concatenate([[middle - half], inner, [middle + half]])
    return float(np.abs(np.diff(np.interp(strains, strain, capacitance))).sum() / (2 * half))


def widest_linear(
    strain: Curve, capacitance: Curve, least_linearity: float
) -> tuple[float, float, float]:
    """The widest strain window in which a straight line has an R²: its ends, and the slope [pF].

    Strains are evenly spaced. Of equally wide windows it is that of the steepest line.
    """
    squared, slope = _fits(strain, capacitance)
    width = strain[None, :] - strain[:, None]
    # Two points are always on a line.
    usable = (squared >= least_linearity) & (width > 1.5 * (strain[1] - strain[0]))
    if not usable.any():
        return float(strain[0]), float(strain[0]), 0.0
    widest = usable & np.isclose(width, width[usable].max())
    steepest = np.argmax(np.where(widest, np.abs(slope), -1.0))
    first, last = np.unravel_index(steepest, width.shape)
    return float(strain[first]), float(strain[last]), float(slope[first, last])


def _fits(
    strain: Curve, capacitance: Curve
) -> tuple[Float[np.ndarray, "first last"], Float[np.ndarray, "first last"]]:
    """R² and slope of the straight line through every window of points, from first to last."""
    x = strain - strain.mean()
    y = capacitance - capacitance.mean()
    sums = np.cumsum([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    before = np.concatenate([np.zeros((6, 1)), sums[:, :-1]], axis=1)
    count, sx, sy, sxx, sxy, syy = sums[:, None, :] - before[:, :, None]
    count = np.maximum(count, 1)
    xx = sxx - sx * sx / count
    xy = sxy - sx * sy / count
    yy = syy - sy * sy / count
    ahead = np.arange(len(x))[None, :] > np.arange(len(x))[:, None]
    varies = ahead & (yy > np.finfo(float).eps * np.abs(y).max() ** 2)
    safe_xx = np.where(ahead, xx, 1.0)
    safe_yy = np.where(varies, yy, 1.0)
    squared = np.where(varies, np.minimum(xy**2 / (safe_xx * safe_yy), 1.0), 0.0)
    return squared, np.where(ahead, xy / safe_xx, 0.0)


def hysteresis(loading: Curve, unloading: Curve) -> float:
    """Largest difference of two curves at the same strains, over their range; NaNs are ignored."""
    both = np.isfinite(loading) & np.isfinite(unloading)
    if not both.any():
        return float("nan")
    span = np.ptp(np.concatenate([loading[both], unloading[both]]))
    return float(np.abs(loading - unloading)[both].max() / span) if span else 0.0


def strain_unfolded(strain: Curve, fold: Curve, left: float) -> float:
    """Applied strain at which unfolding is complete, NaN if it is not within the test [1].

    The mean angle of the folds between the electrodes has fallen to the fraction ``left`` of its
    relaxed value, or to its minimum, if they close again from there on as in a checkerboard.
    """
    least = int(np.argmin(fold))
    open_enough = np.flatnonzero(fold <= left * fold[0])
    if open_enough.size and 0 < open_enough[0] <= least:
        last = open_enough[0]
        around = slice(last - 1, last + 1)
        return float(np.interp(-left * fold[0], -fold[around], strain[around]))
    return float(strain[least]) if 0 < least < len(strain) - 1 else float("nan")
