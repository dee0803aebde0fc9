"""Readings that are no measurements: single ones that depart from their neighbours, and saturation.

A reading that departs lies outside what the readings before and after it predict, while these agree
with each other. Steps that persist, such as the snaps of a fabric, are therefore kept.
"""

import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

SIDE = 5  # readings on either side that predict one
MAX_RUN = 3  # of different readings that depart together
SCATTERS = 6.0  # by which a reading departs at least
NORMAL = 1.4826  # standard deviation over the median of absolute deviations
STEP = 1.5  # of a step between both sides, by which a reading may pass it as the fabric relaxes
WINDOW = 101  # readings that determine the scatter
ROUND_OFF = 1e-9  # of the largest reading, below which nothing departs
MIN_USUAL = 0.5  # of a record, without long runs of equal readings
MIN_BENDS = 0.1  # of the readings at which a rounded record changes its slope
MAX_SHARE = 0.1  # runs that depart, over all readings; more are the shape of the record
MIN_FLAT = 5  # equal readings of a saturated record
FLAT = 5  # times as many as at the levels next to it
MOVING = 0.02  # of the range of strain, over which they are equal

Record = Float[np.ndarray, " record"]
Places = Int[np.ndarray, " record"]
Runs = Int[np.ndarray, " run"]
Chosen = Bool[np.ndarray, " record"]


def without_bad_readings(
    name: str, values: Record, strain: Record | None = None, *, bottom: bool = False
) -> tuple[Record, list[str]]:
    """A record with NaN for readings that depart or are saturated, and lines that count them.

    With a strain, saturation is looked for at the top of the record and, if asked, at the bottom.
    """
    kept, lines = values.copy(), list[str]()
    bad = departing(values, strain)
    runs = int(np.sum(bad[1:] > bad[:-1]))
    if runs:
        is_shape = runs > max(1, MAX_SHARE * len(values))
        done = "too many to leave out" if is_shape else "left out"
        lines.append(f"{bad.sum()} readings of {name} depart from their neighbours: {done}")
        kept[bad & (not is_shape)] = np.nan
    if strain is not None and (flat := saturated(kept, strain, bottom=bottom)).any():
        limits = " and ".join(f"{limit:.4g}" for limit in np.unique(kept[flat]))
        lines.append(f"{flat.sum()} readings of {name} are saturated at {limits}: left out")
        kept[flat] = np.nan
    return kept, lines


def departing(values: Record, strain: Record | None = None) -> Chosen:
    """Which readings depart by many scatters from their neighbours, which agree with each other.

    They are one to three in a row; or with a strain, any number of equal ones during which it
    changes, as of a logger that wrote zeros.
    """
    left = np.arange(len(values))
    floor = max(rounding_step(values), _least_bend(values)) / 2
    while len(left) > SIDE:
        found = _departing(left, values[left], floor, None if strain is None else strain[left])
        if not found.any():
            break
        left = left[~found]
    return np.isin(np.arange(len(values)), left, invert=True)


def saturated(values: Record, strain: Record, *, bottom: bool = False) -> Chosen:
    """Which readings are at the top, or bottom, of a range that the quantity has left.

    Many in a row are equal there while the strain changes, and readings elsewhere are not.
    """
    known = np.flatnonzero(np.isfinite(values))
    at_limit = np.zeros(len(values), bool)
    starts, stops = _equal(values[known])
    lengths = stops - starts
    limits = [values[known].max(), values[known].min()]
    for limit in limits if bottom else limits[:1]:
        run = int(np.where(values[known[starts]] == limit, lengths, 0).argmax())
        nearby = [*lengths[max(run - 3, 0) : run], *lengths[run + 1 : run + 4]]
        passed = strain[known[starts[run] : stops[run]]]
        moved = _range(passed) > MOVING * _range(strain)
        if nearby and moved and lengths[run] >= max(MIN_FLAT, FLAT * max(nearby)):
            at_limit |= values == limit
    return at_limit


def rounding_step(values: Record) -> float:
    """The step between levels that are read twice in a row; 0 if there are none."""
    held = np.isin(values, values[1:][np.diff(values) == 0])
    steps = np.abs(np.diff(values))[held[1:] & held[:-1]]
    return float(steps[steps > 0].min()) if steps.any() else 0.0


def _range(values: Record) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _equal(values: Record) -> tuple[Runs, Runs]:
    """First reading of each run of equal ones, and the one after its last."""
    changes = np.flatnonzero(np.diff(values)) + 1
    return np.concatenate([[0], changes]), np.concatenate([changes, [len(values)]])


class _Lines(NamedTuple):
    """Lines through readings: at each place those before it, or those from it on."""

    slope: Record
    value: Record  # at place 0
    scatter: Record  # of the readings around it

    def at(self, line: Places, place: Places) -> Record:
        """Values of some lines at places."""
        return self.value[line] + self.slope[line] * place


def _departing(at: Places, values: Record, floor: float, strain: Record | None) -> Chosen:
    """Which readings, left of a record at some places, depart; others may only then be seen."""
    before, after = _lines(at, values)
    starts, stops = _equal(values)
    scatter = _scatter(values, stops - starts)
    scatter = np.maximum(scatter, max(floor, ROUND_OFF * float(np.abs(values).max())))

    def outside(start: Places, stop: Places, reading: Places) -> Chosen:
        one, other = before.at(start, at[reading]), after.at(stop, at[reading])
        low, high, value = np.minimum(one, other), np.maximum(one, other), values[reading]
        turn = np.abs(before.slope[start] - after.slope[stop]) * (at[stop - 1] + 1 - at[start])
        around = np.maximum(before.scatter[start], after.scatter[stop])
        allowed = SCATTERS * np.maximum(scatter[reading], around) + turn + STEP * (high - low)
        return np.maximum(low - value, value - high) > allowed

    found = np.zeros(len(values), bool)
    for length in range(1, MAX_RUN + 1):
        start = np.arange(len(values) - length + 1)
        each = [outside(start, start + length, start + place) for place in range(length)]
        for first in np.flatnonzero(np.all(each, axis=0)):
            found[first : first + length] = True
    if strain is not None:
        long = stops - starts > MAX_RUN
        start, stop = starts[long], stops[long]
        departs = outside(start, stop, start) & outside(start, stop, stop - 1)
        departs &= np.abs(strain[stop - 1] - strain[start]) > 0
        for run in np.flatnonzero(departs):
            found[start[run] : stop[run]] = True
    return found


def _scatter(values: Record, runs: Runs) -> Record:
    """The noise around each reading, by second differences; ``runs`` are of equal readings."""
    bend = np.abs(np.diff(values, 2)) / np.sqrt(6)
    # Unusually many equal readings may be those of a logger without a signal.
    usual = np.repeat(runs <= MAX_RUN * np.median(runs), runs)
    informative = np.flatnonzero(usual[1:-1] | (usual.mean() < MIN_USUAL))
    size = min(WINDOW, len(informative))
    median = NORMAL * ndimage.median_filter(bend[informative], size, mode="reflect")
    return np.interp(np.arange(len(values)), informative + 1, median)


def _lines(at: Places, values: Record) -> tuple[_Lines, _Lines]:
    """Lines by the median of slopes through readings before, and from, every place."""
    pad = np.full(SIDE, np.nan)
    padded = [np.concatenate([pad, each, pad]) for each in (at.astype(float), values)]
    places, levels = (np.lib.stride_tricks.sliding_window_view(each, SIDE) for each in padded)
    one, other = np.triu_indices(SIDE, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of windows without readings
        rise = levels[:, other] - levels[:, one]
        slope = np.nanmedian(rise / (places[:, other] - places[:, one]), axis=1)
        slope = np.nan_to_num(slope)  # of one reading
        levels = levels - slope[:, None] * places
        value = np.nanmedian(levels, axis=1)
        scatter = NORMAL * np.nanmedian(np.abs(levels - value[:, None]), axis=1)
    lines = slope, value, scatter
    return _Lines(*(each[:-SIDE] for each in lines)), _Lines(*(each[SIDE:] for each in lines))


def _least_bend(values: Record) -> float:
    """The smallest change of slope at a reading, as by rounding; 0 if there are few changes."""
    bends = np.abs(np.diff(values, 2))
    bends = bends[bends > ROUND_OFF * np.abs(values).max()]
    return float(bends.min()) if len(bends) > MIN_BENDS * len(values) else 0.0
