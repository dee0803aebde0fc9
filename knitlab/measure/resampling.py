"""Resampling: laboratory records at requested strains.

At every strain a parabola is fitted to the records nearby, which averages their noise and estimates
it.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

FEWEST_POINTS = {2: 8, 1: 4, 0: 3}
"""Number of points needed for a polynomial, by its degree; the first with enough is used."""
LEAST_CURVATURE = 1e-6
"""Smallest over largest eigenvalue of the normal equations, below which points are too close."""
AT_REST = 1e-9
"""Range of the strains of records at rest, over the width of a window."""
DRAWN_OUT = 0.1
"""Largest extrapolation of a polynomial beyond its last point, over its length."""

Strains = Float[np.ndarray, " strain"]
Records = Float[np.ndarray, "record *series"]


class Resampled(NamedTuple):
    """Records at given strains.

    Attributes:
        values: values at the strains; NaN if no record is near.
        errors: their standard errors; NaN if there are too few records.
        noise: standard deviation of a single record at each strain.
    """

    values: Float[np.ndarray, "strain *series"]
    errors: Float[np.ndarray, "strain *series"]
    noise: Float[np.ndarray, "strain *series"]


def resampled(at: Strains, strain: Float[np.ndarray, " record"], values: Records) -> Resampled:
    """Records resampled at given strains, with standard errors.

    A parabola is fitted to the records within half the distance to the next strains, for every
    series separately, as records may be missing in one only; with few records, a line or a mean. If
    even that is impossible, the value is interpolated linearly between the nearest records on
    both sides, and has no error.

    Args:
        at: requested strains, ascending [1].
        strain: strain of every record [1].
        values: the records; NaN if missing.
    """
    low, high = _windows(at)
    series = np.reshape(values, (len(strain), math.prod(np.shape(values)[1:])))
    found = np.full((3, len(at), series.shape[1]), np.nan)
    for place, centre in enumerate(at):
        window = (strain >= low[place]) & (strain <= high[place])
        width = high[place] - low[place]
        found[:, place] = _at_zero((strain[window] - centre) / width, series[window])
        for missing in np.flatnonzero(np.isnan(found[0, place])):
            known = np.isfinite(series[:, missing])
            found[0, place, missing] = _between(
                centre, strain[known], series[known, missing], width
            )
    return Resampled(*found.reshape(3, len(at), *np.shape(values)[1:]))


def _windows(at: Strains) -> tuple[Strains, Strains]:
    middles = (at[1:] + at[:-1]) / 2
    first, last = 2 * at[:1] - middles[:1], 2 * at[-1:] - middles[-1:]
    return np.concatenate([first, middles]), np.concatenate([middles, last])


def _at_zero(
    offset: Float[np.ndarray, " record"], series: Float[np.ndarray, "record series"]
) -> Float[np.ndarray, "3 series"]:
    """Values at zero of polynomials fitted to series, their standard errors, and the noise."""
    known = np.isfinite(series)
    value = np.where(known, series, 0.0)
    found = np.full((3, series.shape[1]), np.nan)
    if not len(offset):
        return found
    first = np.where(known, offset[:, None], np.inf).min(axis=0)
    last = np.where(known, offset[:, None], -np.inf).max(axis=0)
    covered = np.maximum(first, -last) <= DRAWN_OUT * np.ptp(offset)
    for degree, fewest in FEWEST_POINTS.items():
        powers = offset[:, None] ** np.arange(degree + 1)
        normal = np.einsum("np,nq,ns->spq", powers, powers, known)
        curvatures, vectors = np.linalg.eigh(normal)
        fitted = covered & np.isnan(found[0]) & (known.sum(axis=0) >= fewest)
        fitted &= curvatures[:, 0] > LEAST_CURVATURE * curvatures[:, -1]
        # A mean is only for records at rest, all at one strain.
        fitted &= degree > 0 or np.ptp(offset) <= AT_REST
        vectors, curvatures = vectors[fitted], curvatures[fitted]
        right = np.einsum("np,ns->sp", powers, value[:, fitted])
        along = np.einsum("spk,sp->sk", vectors, right) / curvatures
        coefficients = np.einsum("spk,sk->sp", vectors, along)
        left = np.where(known[:, fitted], value[:, fitted] - powers @ coefficients.T, 0.0)
        freedom = known[:, fitted].sum(axis=0) - degree - 1
        noise = np.sqrt((left**2).sum(axis=0) / freedom)
        leverage = (vectors[:, 0] ** 2 / curvatures).sum(axis=1)
        found[:, fitted] = coefficients[:, 0], noise * np.sqrt(leverage), noise
    return found


def _between(
    centre: float,
    strain: Float[np.ndarray, " record"],
    values: Float[np.ndarray, " record"],
    reach: float,
) -> float:
    """The value interpolated between the nearest records on both sides within reach; else NaN."""
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
