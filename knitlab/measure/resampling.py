"""Resampling: what a laboratory recorded, at the strains at which it is asked for.

At every strain a straight line is fitted to what was recorded nearby, which makes the most of
noisy records and says how noisy they are.
"""

import numpy as np
from jaxtyping import Float

FEWEST_POINTS = 3
"""Points of a line with an error."""
DRAWN_OUT = 0.1
"""How far beyond its last point a line may be drawn, as a part of its length."""
LEAST_SPREAD = 1e-12
"""Variance of the strains in a window, over its squared width, below which there is no slope."""

Strains = Float[np.ndarray, " strain"]
Records = Float[np.ndarray, "record *series"]


def resampled(
    at: Strains, strain: Float[np.ndarray, " record"], values: Records
) -> tuple[Float[np.ndarray, "strain *series"], Float[np.ndarray, "strain *series"]]:
    """Records at given strains, and the standard errors of that.

    A line is fitted to the records within half the distance to the next of the strains, every
    series by itself, as records may be missing in one only. Where there are fewer than three, or
    all on one side of the strain though the record goes on, the value lies on the line between
    the nearest records on both sides, and has no error.

    Args:
        at: strains that are asked for, ascending [1].
        strain: of every record [1].
        values: the records; NaN where one is missing.

    Returns:
        Values and errors; NaN where no record is near.
    """
    low, high = _windows(at)
    series = np.reshape(values, (len(strain), -1))
    found, errors = (np.full((len(at), series.shape[1]), np.nan) for _ in range(2))
    for place, centre in enumerate(at):
        window = (strain >= low[place]) & (strain <= high[place])
        found[place], errors[place] = _line_at_zero(strain[window] - centre, series[window])
        for missing in np.flatnonzero(np.isnan(found[place])):
            there = np.isfinite(series[:, missing])
            found[place, missing] = _between(
                centre, strain[there], series[there, missing], high[place] - low[place]
            )
    shape = (len(at), *np.shape(values)[1:])
    return found.reshape(shape), errors.reshape(shape)


def _windows(at: Strains) -> tuple[Strains, Strains]:
    middles = (at[1:] + at[:-1]) / 2
    first, last = 2 * at[:1] - middles[:1], 2 * at[-1:] - middles[-1:]
    return np.concatenate([first, middles]), np.concatenate([middles, last])


def _line_at_zero(
    offset: Float[np.ndarray, " record"], series: Float[np.ndarray, "record series"]
) -> tuple[Float[np.ndarray, " series"], Float[np.ndarray, " series"]]:
    """Where the lines through series cross zero, and the standard errors of that."""
    there = np.isfinite(series)
    weight = there.astype(float)
    value = np.where(there, series, 0.0)
    count = weight.sum(axis=0)
    able = count >= FEWEST_POINTS
    safe = np.maximum(count, 1)
    middle, mean = (offset @ weight) / safe, value.sum(axis=0) / safe
    across = (offset[:, None] - middle) * weight
    spread, tilt = (across**2).sum(axis=0), (across * value).sum(axis=0)
    width = np.ptp(offset) if len(offset) else 0.0
    ends = (
        np.where(there, offset[:, None], np.inf).min(axis=0, initial=np.inf),
        -np.where(there, offset[:, None], -np.inf).max(axis=0, initial=-np.inf),
    )
    sloped = spread > LEAST_SPREAD * max(width, np.finfo(float).tiny) ** 2
    slope = np.where(sloped, tilt / np.where(sloped, spread, 1.0), 0.0)
    # A line must not be drawn out to where no record is.
    able &= np.maximum(*ends) <= DRAWN_OUT * width
    left = ((value - mean - slope * across) * weight) ** 2
    freedom = np.maximum(count - 1 - sloped, 1)
    noise = left.sum(axis=0) / freedom
    leverage = 1 / safe + np.where(sloped, middle**2 / np.where(sloped, spread, 1.0), 0.0)
    at_zero, error = mean - slope * middle, np.sqrt(noise * leverage)
    return np.where(able, at_zero, np.nan), np.where(able, error, np.nan)


def _between(
    centre: float,
    strain: Float[np.ndarray, " record"],
    values: Float[np.ndarray, " record"],
    reach: float,
) -> float:
    """The value between the nearest records on both sides, of those within reach; else NaN."""
    before, after = strain <= centre, strain >= centre
    if not (before.any() and after.any()):
        return np.nan
    first = np.flatnonzero(before)[np.argmax(strain[before])]
    second = np.flatnonzero(after)[np.argmin(strain[after])]
    if max(centre - strain[first], strain[second] - centre) > reach:
        return np.nan
    if strain[first] == strain[second]:
        return float(values[[first, second]].mean())
    part = (centre - strain[first]) / (strain[second] - strain[first])
    return float(values[first] + part * (values[second] - values[first]))
