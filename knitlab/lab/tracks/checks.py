"""Checks of tracked markers: a position that a fabric cannot have is taken as lost.

The displacement of a marker follows from those of its neighbours. A marker that departs from this,
coincides with another, stands still or turns a unit cell over is dropped from then on.
"""

import warnings
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

JUMP = 0.35  # departure from the neighbours that one frame may add, over the step of the grid
COINCIDENT = 0.05  # distance of two markers, over the step of the grid
MIN_STILL = 3  # frames at exactly one position
IN_ROW = [3, 7, 8]  # predictions of a displacement by its own row
DIRECTIONS = [(y, x) for y, x in product((-1, 0, 1), repeat=2) if (y, x) != (0, 0)]
STILL = 0.1  # departure from the neighbours meanwhile, over the step of the grid

Corners = Float[np.ndarray, "frame row column 2"]
Field = Float[np.ndarray, "row column 2"]
Fields = Float[np.ndarray, "*frame row column 2"]


class Dropped(NamedTuple):
    """A marker that is lost from a frame on, by its row and column in the grid, and why."""

    row: int
    column: int
    frame: int
    reason: str


def without_implausible(relaxed: Field, corners: Corners) -> tuple[Corners, list[Dropped]]:
    """A grid of markers without the positions that no fabric has, and what was dropped."""
    steps = [np.linalg.norm(np.diff(relaxed, axis=axis), axis=-1) for axis in (0, 1)]
    step = min(float(np.nanmedian(each)) for each in steps)
    kept, dropped = corners.copy(), list[Dropped]()

    def drop(marker: tuple[int, int], frame: int, reason: str) -> None:
        kept[(slice(frame, None), *marker)] = np.nan
        dropped.append(Dropped(*marker, frame, reason))

    # Where each marker was in the frame before, or where its neighbours have moved it to since.
    before = relaxed.copy()
    for frame, now in enumerate(kept):
        for marker in _jumping(now - before, JUMP * step):
            drop(marker, frame, "jumps away from its neighbours")
        at = _shifted(now, 1)
        close = np.any([_length(now - at(y, x)) < COINCIDENT * step for y, x in DIRECTIONS], axis=0)
        for row, column in np.argwhere(close).tolist():
            drop((row, column), frame, "coincides with another marker")
        while (over := _turned_over(now)).any():
            departure = now - relaxed - predicted_by_neighbours(now - relaxed)
            size = np.where(over, 1 + np.nan_to_num(_length(departure)), 0.0)
            row, column = divmod(int(size.argmax()), size.shape[1])
            drop((row, column), frame, "turns a unit cell over")
        moved = np.nan_to_num(predicted_by_neighbours(now - before))
        before = np.where(np.isfinite(now), now, before + moved)
    while (still := _still(kept - relaxed, STILL * step)) is not None:
        drop(*still, "stands still while its neighbours move")
    return kept, dropped


def _length(vectors: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any"]:
    return np.linalg.norm(vectors, axis=-1)


def _jumping(moved: Field, least: float) -> list[tuple[int, int]]:
    """Markers that move unlike their neighbours, taken one by one so that the others agree most."""

    def departed() -> Float[np.ndarray, "row column"]:
        return np.nan_to_num(_length(kept - predicted_by_neighbours(kept)))

    kept, jumping = moved.copy(), list[tuple[int, int]]()
    while suspects := np.argwhere(departed() > least).tolist():
        left = []
        for row, column in suspects:
            kept[row, column] = np.nan
            left.append(departed().sum())
            kept[row, column] = moved[row, column]
        row, column = suspects[int(np.argmin(left))]
        kept[row, column] = np.nan
        jumping.append((row, column))
    for marker in jumping.copy():
        kept[marker] = moved[marker]
        if (departed() > least).any():
            kept[marker] = np.nan
        else:
            jumping.remove(marker)
    return jumping


def predicted_by_neighbours(displacement: Fields) -> Fields:
    """Median of what neighbours predict, exact for affine deformation; NaN without neighbours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of markers without neighbours
        return np.nanmedian(_predictions(displacement), axis=0)


def _shifted(field: Fields, reach: int) -> Callable[[int, int], Fields]:
    """What gives, at every marker, the value some rows and columns away; NaN beyond the grid."""
    rows, columns = field.shape[-3:-1]
    margin = [(0, 0)] * (field.ndim - 3) + [(reach, reach), (reach, reach), (0, 0)]
    padded = np.pad(field, margin, constant_values=np.nan)
    return lambda y, x: padded[..., reach + y :, reach + x :, :][..., :rows, :columns, :]


def _predictions(displacement: Fields) -> Float[np.ndarray, "prediction *frame row column 2"]:
    """Means of opposite neighbours, extrapolations of two in a row, fourth corners of three."""
    at = _shifted(displacement, 2)
    predicted = [(at(y, x) + at(-y, -x)) / 2 for y, x in DIRECTIONS[:4]]
    predicted += [2 * at(y, x) - at(2 * y, 2 * x) for y, x in DIRECTIONS]
    predicted += [at(y, 0) + at(0, x) - at(y, x) for y, x in product((-1, 1), repeat=2)]
    return np.array(predicted)


def _still(displacement: Corners, least: float) -> tuple[tuple[int, int], int] | None:
    """The marker that stays while neighbours, one of its own row, move most; and since when."""
    same = (np.diff(displacement, axis=0) == 0).all(axis=-1)
    suspects = np.argwhere(same.sum(axis=0) >= MIN_STILL - 1).tolist()
    if not suspects:
        return None
    predictions = _predictions(displacement)
    worst, still = least, None
    for row, column in suspects:
        for (span,) in ndimage.find_objects(ndimage.label(same[:, row, column])[0]):
            own = predictions[:, [span.start, span.stop], row, column]
            moves = _length(own[:, 1] - own[:, 0])
            if span.stop - span.start < MIN_STILL - 1 or np.isnan(moves[IN_ROW]).all():
                continue
            if (away := float(np.nanmin(moves))) > worst:
                worst, still = away, ((row, column), span.start + 1)
    return still


def _turned_over(positions: Field) -> Bool[np.ndarray, "row column"]:
    """Markers seen at a corner of a cell whose signed area is not positive."""
    low, high = positions[:-1], positions[1:]
    one, other = high[:, 1:] - low[:, :-1], high[:, :-1] - low[:, 1:]  # the diagonals
    over = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0] <= 0
    corners = [np.pad(over, ((y, 1 - y), (x, 1 - x))) for y, x in product((0, 1), repeat=2)]
    return np.any(corners, axis=0) & np.isfinite(positions[..., 0])
