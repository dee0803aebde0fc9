"""Records of a machine or a camera: separated into cycles, and resampled by local parabolas."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

MIN_POINTS = {2: 8, 1: 4, 0: 3}  # points needed by a polynomial of this degree
MIN_CURVATURE = 1e-6  # of normal equations, smallest over largest, if points are not too close
AT_REST = 1e-9  # range of the strains of records at rest, over the width of a window
WITHIN_NOISE = 8.0  # range of the records of a hold, over the standard deviation of their noise
AT_SPEED = 20.0  # motion at the usual speed during the shortest hold, over that range
ABOVE_NOISE = 30.0  # motion from which a speed is estimated, over its standard deviation
MIN_SPEED = 0.05  # of the machine while it moves, over the largest
MIN_STEPS = 5.0  # and over the resolution
MIN_HELD = 10  # records of a hold
DRAWN_OUT = 0.1  # largest extrapolation of a polynomial beyond its last point, over its length

Record = Float[np.ndarray, " record"]


@dataclass(frozen=True)
class Cycle:
    """Times at which a cycle starts, turns and ends; in ``holds`` the machine stands still."""

    start: float
    turn: float
    end: float
    holds: tuple[tuple[float, float], ...] = ()

    def loaded(self, time: Record) -> Bool[np.ndarray, " record"]:
        """Whether times are during loading."""
        loaded = (time >= self.start) & (time <= self.turn)
        for first, last in self.holds:
            loaded &= (time <= first) | (time > last)
        return loaded

    def unloaded(self, time: Record) -> Bool[np.ndarray, " record"]:
        """Whether times are during unloading."""
        unloaded = (time >= self.turn) & (time <= self.end)
        for first, last in self.holds:
            unloaded &= (time < first) | (time >= last)
        return unloaded


def cycles(time: Record, extension: Record, least_turn: float) -> list[Cycle]:
    """The cycles of a test in order, from its extension at ascending times.

    A reversal by less than ``least_turn`` of the range is none. Rest is part of the next loading.
    """
    span = np.ptp(extension)
    if not span > 0:
        return []
    turns = _turns(extension, least_turn * span)
    # A test may end without unloading.
    triples = zip(turns, turns[1:], [*turns[2:], *turns[-1:]], strict=False)
    holds = [(float(time[first]), float(time[last])) for first, last in _holds(extension)]
    made = []
    for low, high, last in triples:
        if extension[high] > extension[low]:
            start, turn, end = time[[low, high, last]].tolist()
            within = tuple(each for each in holds if start < each[0] <= end)
            made.append(Cycle(start, turn, end, within))
    return made


def _holds(extension: Record) -> list[tuple[int, int]]:
    """First and last records of the spans in which the machine stands still but for noise."""
    steps = np.abs(np.diff(extension))
    if len(steps) < 2 or not steps.any():
        return []
    # The median second difference of a ramp is that of its noise, of variance 1 + 4 + 1.
    noise = 1.4826 * np.median(np.abs(np.diff(extension, 2))) / math.sqrt(6)
    interval, moved = 1, steps
    while moved.max() < ABOVE_NOISE * noise and 2 * interval < len(extension):
        interval *= 2
        moved = np.abs(extension[interval:] - extension[:-interval])
    speed = np.median(moved[moved > MIN_SPEED * moved.max()]) / interval
    band = WITHIN_NOISE * noise
    needed = max(AT_SPEED * band, MIN_STEPS * steps[steps > 0].min()) / speed
    length = max(MIN_HELD, math.ceil(needed))
    if length > len(extension):
        return []
    windows = np.lib.stride_tricks.sliding_window_view(extension, length)
    still = np.convolve(np.ptp(windows, axis=1) <= band, np.ones(length)) > 0.5
    spans = ndimage.find_objects(ndimage.label(still)[0])
    return [(span.start, span.stop - 1) for (span,) in spans]


def _turns(extension: Record, least: float) -> list[int]:
    """Indices of alternating minima and maxima, each ``least`` away from the previous one."""
    lowest = highest = 0
    turns: list[int] = []
    rising = None
    for index, value in enumerate(extension):
        # Loading is from the last of equal minima to the first of equal maxima.
        if value <= extension[lowest]:
            lowest = index
        if value > extension[highest]:
            highest = index
        if rising is not False and extension[highest] - value >= least:
            turns += [lowest, highest] if rising is None and lowest < highest else [highest]
            rising, lowest = False, index
        elif rising is not True and value - extension[lowest] >= least:
            turns.append(lowest)
            rising, highest = True, index
    last = highest if rising else lowest
    if rising is not None and last != turns[-1]:
        turns.append(last)
    return turns


class Resampled(NamedTuple):
    """Values at strains, standard errors, and the noise of a record; NaN without records."""

    values: Float[np.ndarray, "strain *series"]
    errors: Float[np.ndarray, "strain *series"]
    noise: Float[np.ndarray, "strain *series"]


def resampled(
    at: Float[np.ndarray, " strain"], strain: Record, values: Float[np.ndarray, "record *series"]
) -> Resampled:
    """Records resampled at ascending strains, each series by itself, with standard errors.

    A parabola is fitted to the records near a strain; to few, a line or a mean. Else the value is
    interpolated, without error.
    """
    middles = (at[1:] + at[:-1]) / 2
    ends = np.concatenate([[2 * at[0] - middles[0]], middles, [2 * at[-1] - middles[-1]]])
    series = np.reshape(values, (len(strain), math.prod(np.shape(values)[1:])))
    fits = np.full((3, len(at), series.shape[1]), np.nan)
    for fit, centre, first, last in zip(fits.swapaxes(0, 1), at, ends[:-1], ends[1:], strict=True):
        window, width = (strain >= first) & (strain <= last), last - first
        fit[:] = _at_zero((strain[window] - centre) / width, series[window])
        for column in np.flatnonzero(np.isnan(fit[0])):
            known = np.isfinite(series[:, column])
            fit[0, column] = _between(centre, strain[known], series[known, column], width)
    return Resampled(*fits.reshape(3, len(at), *np.shape(values)[1:]))


def _at_zero(
    offset: Record, series: Float[np.ndarray, "record series"]
) -> Float[np.ndarray, "3 series"]:
    known = np.isfinite(series)
    value = np.where(known, series, 0.0)
    fits = np.full((3, series.shape[1]), np.nan)
    if not len(offset):
        return fits
    first = np.where(known, offset[:, None], np.inf).min(axis=0)
    last = np.where(known, offset[:, None], -np.inf).max(axis=0)
    covered = np.maximum(first, -last) <= DRAWN_OUT * np.ptp(offset)
    for degree, fewest in MIN_POINTS.items():
        powers = offset[:, None] ** np.arange(degree + 1)
        curvatures, vectors = np.linalg.eigh(np.einsum("np,nq,ns->spq", powers, powers, known))
        fitted = covered & np.isnan(fits[0]) & (known.sum(axis=0) >= fewest)
        fitted &= curvatures[:, 0] > MIN_CURVATURE * curvatures[:, -1]
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
        fits[:, fitted] = coefficients[:, 0], noise * np.sqrt(leverage), noise
    return fits


def _between(centre: float, strain: Record, values: Record, reach: float) -> float:
    """The value interpolated between the nearest records on both sides within reach; else NaN."""
    before, after = np.flatnonzero(strain <= centre), np.flatnonzero(strain >= centre)
    if not (before.size and after.size):
        return np.nan
    nearest = [before[np.argmax(strain[before])], after[np.argmin(strain[after])]]
    (first, second), ends = strain[nearest], values[nearest]
    if max(centre - first, second - centre) > reach:
        return np.nan
    return float(ends.mean() if first == second else np.interp(centre, (first, second), ends))
