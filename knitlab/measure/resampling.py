"""Resampling: what a laboratory recorded, at requested strains.

At every strain a parabola is fitted to what was recorded nearby, which makes the most of noisy
records and estimates how noisy they are.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

FEWEST_POINTS = {2: 8, 1: 4, 0: 3}
"""Points that a polynomial of a degree is fitted to, the first of these with enough."""
LEAST_CURVATURE = 1e-6
"""Of the normal equations over their largest; below it the points are too few places apart."""
AT_REST = 1e-9
"""Spread of the strains of records at rest, over the width of a window."""
DRAWN_OUT = 0.1
"""How far beyond its last point a polynomial may be drawn, as a part of its length."""

Strains = Float[np.ndarray, " strain"]
Records = Float[np.ndarray, "record *series"]


class Resampled(NamedTuple):
    """Records at given strains.

    Attributes:
        values: at the strains; NaN where no record is near.
        errors: their standard errors; NaN where the records are too few to tell.
        noise: standard deviation of a single record there.
    """

    values: Float[np.ndarray, "strain *series"]
    errors: Float[np.ndarray, "strain *series"]
    noise: Float[np.ndarray, "strain *series"]


def resampled(at: Strains, strain: Float[np.ndarray, " record"], values: Records) -> Resampled:
    """Records at given strains, with the standard errors of that.

    A parabola is fitted to the records within half the distance to the next of the strains, every
    series by itself, as records may be missing in one only; a line or a mean where they are few.
    Where even that cannot be, the value lies on the line between the nearest records on both
    sides, and has no error.

    Args:
        at: requested strains, ascending [1].
        strain: of every record [1].
        values: the records; NaN where one is missing.
    """
    low, high = _windows(at)
    series = np.reshape(values, (len(strain), math.prod(np.shape(values)[1:])))
    found = np.full((3, len(at), series.shape[1]), np.nan)
    for place, centre in enumerate(at):
        window = (strain >= low[place]) & (strain <= high[place])
        width = high[place] - low[place]
        found[:, place] = _at_zero((strain[window] - centre) / width, series[window])
        for missing in np.flatnonzero(np.isnan(found[0, place])):
            there = np.isfinite(series[:, missing])
            found[0, place, missing] = _between(
                centre, strain[there], series[there, missing], width
            )
    return Resampled(*found.reshape(3, len(at), *np.shape(values)[1:]))


def _windows(at: Strains) -> tuple[Strains, Strains]:
    middles = (at[1:] + at[:-1]) / 2
    first, last = 2 * at[:1] - middles[:1], 2 * at[-1:] - middles[-1:]
    return np.concatenate([first, middles]), np.concatenate([middles, last])


def _at_zero(
    offset: Float[np.ndarray, " record"], series: Float[np.ndarray, "record series"]
) -> Float[np.ndarray, "3 series"]:
    """What polynomials through series have at zero, the standard errors of that, and the noise."""
    there = np.isfinite(series)
    value = np.where(there, series, 0.0)
    found = np.full((3, series.shape[1]), np.nan)
    if not len(offset):
        return found
    first = np.where(there, offset[:, None], np.inf).min(axis=0)
    last = np.where(there, offset[:, None], -np.inf).max(axis=0)
    covered = np.maximum(first, -last) <= DRAWN_OUT * np.ptp(offset)
    for degree, fewest in FEWEST_POINTS.items():
        powers = offset[:, None] ** np.arange(degree + 1)
        normal = np.einsum("np,nq,ns->spq", powers, powers, there)
        curvatures, vectors = np.linalg.eigh(normal)
        able = covered & np.isnan(found[0]) & (there.sum(axis=0) >= fewest)
        able &= curvatures[:, 0] > LEAST_CURVATURE * curvatures[:, -1]
        # A mean is for records at rest, all of them at one strain.
        able &= degree > 0 or np.ptp(offset) <= AT_REST
        vectors, curvatures = vectors[able], curvatures[able]
        right = np.einsum("np,ns->sp", powers, value[:, able])
        along = np.einsum("spk,sp->sk", vectors, right) / curvatures
        coefficients = np.einsum("spk,sk->sp", vectors, along)
        left = np.where(there[:, able], value[:, able] - powers @ coefficients.T, 0.0)
        freedom = there[:, able].sum(axis=0) - degree - 1
        noise = np.sqrt((left**2).sum(axis=0) / freedom)
        leverage = (vectors[:, 0] ** 2 / curvatures).sum(axis=1)
        found[:, able] = coefficients[:, 0], noise * np.sqrt(leverage), noise
    return found


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
