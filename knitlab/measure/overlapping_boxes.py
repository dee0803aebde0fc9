"""Broad phase of a search for intersections: pairs of grid cells whose bounding boxes overlap."""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from knitlab.fabric.network import MeshShape


@dataclass(frozen=True)
class BoxPairs:
    """Pairs of cells, or of cells and periodic images, in all states of one fabric.

    Attributes:
        one, other: cells of each pair, numbered state by state.
        turns: periods (y, x) by which the other cell is displaced.
    """

    one: Int[np.ndarray, " pair"]
    other: Int[np.ndarray, " pair"]
    turns: Int[np.ndarray, "2 pair"]


@dataclass(frozen=True)
class _Bins:
    """Cells sorted into bins, a grid over one period of each state.

    Attributes:
        order: the cells, by bin.
        first: index in ``order`` of the first cell of each bin, and the total.
        start: first bin of the state of each cell.
        number: number of bins (y, x) of the state of each cell.
        bin: bin (y, x) of each cell, within its state.
        turns: periods (y, x) between the cell and its bin.
    """

    order: Int[np.ndarray, " cell"]
    first: Int[np.ndarray, " bins"]
    start: Int[np.ndarray, " cell"]
    number: Int[np.ndarray, "2 cell"]
    bin: Int[np.ndarray, "2 cell"]
    turns: Int[np.ndarray, "2 cell"]


def overlapping_boxes(
    shape: MeshShape,
    low: Float[np.ndarray, "3 state cell"],
    high: Float[np.ndarray, "3 state cell"],
    periods: Float[np.ndarray, "2 state"],
) -> BoxPairs:
    """Pairs of cells, or of cells and images, whose bounding boxes overlap; each once per period.

    Cells are sorted into bins over y and x, no smaller than a box, so that only those of
    neighbouring bins are compared.

    Args:
        shape: mesh of the fabric.
        low: lowest x, y and z of each cell [mm].
        high: highest x, y and z of each cell [mm].
        periods: L_y and L_x of every state [mm].
    """
    size = (high - low).max(axis=2)[1::-1]
    if not shape.periodic:
        # Long enough that no cell overlaps an image.
        periods = (low.max(axis=2) - low.min(axis=2))[1::-1] + 2 * size
    number = np.maximum(1, periods // size)
    reach_y, reach_x = np.ceil(size * number / periods).max(axis=1).astype(int)
    bins = _bins(low[1::-1], number.astype(int), periods)
    steps = itertools.product(range(reach_y + 1), range(-reach_x, reach_x + 1))
    # One of two opposite steps is enough to find a pair.
    found = [
        _overlapping(bins, np.array(step), low, high, periods) for step in steps if step >= (0, 0)
    ]
    return BoxPairs(
        *(
            np.concatenate([getattr(pairs, name) for pairs in found], axis=-1)
            for name in ("one", "other", "turns")
        )
    )


def _bins(
    low: Float[np.ndarray, "2 state cell"],
    number: Int[np.ndarray, "2 state"],
    periods: Float[np.ndarray, "2 state"],
) -> _Bins:
    cells = low.shape[2]
    share = (low - low.min(axis=2, keepdims=True)) / periods[..., None]
    turns = np.floor(share)
    last = number[..., None] - 1
    index = np.minimum(((share - turns) * number[..., None]).astype(int), last).reshape(2, -1)
    ends = np.cumsum(number.prod(axis=0))
    start = np.repeat(ends - number.prod(axis=0), cells)
    number = np.repeat(number, cells, axis=1)
    key = start + index[0] * number[1] + index[1]
    first = np.concatenate([[0], np.cumsum(np.bincount(key, minlength=ends[-1]))])
    order = np.argsort(key, kind="stable")
    return _Bins(order, first, start, number, index, turns.reshape(2, -1).astype(int))


def _overlapping(
    bins: _Bins,
    step: Int[np.ndarray, " 2"],
    low: Float[np.ndarray, "3 state cell"],
    high: Float[np.ndarray, "3 state cell"],
    periods: Float[np.ndarray, "2 state"],
) -> BoxPairs:
    """Pairs with overlapping boxes, whose bins differ by a step (y, x)."""
    around, neighbour = np.divmod(bins.bin + step[:, None], bins.number)
    key = bins.start + neighbour[0] * bins.number[1] + neighbour[1]
    count = bins.first[key + 1] - bins.first[key]
    one = np.repeat(np.arange(len(key)), count)
    ahead = bins.first[key] - np.cumsum(count) + count
    other = bins.order[np.arange(len(one)) + np.repeat(ahead, count)]
    if not step.any():
        kept = one < other
        one, other = one[kept], other[kept]
    # The grid is (y, x), coordinates are (x, y, z).
    for axis, along in ((0, 1), (1, 0), (2, None)):
        bottom, top = low[axis].ravel(), high[axis].ravel()
        moved: Float[np.ndarray, " pair"] | float = 0.0
        if along is not None:
            turns = around[along, one] + bins.turns[along, one] - bins.turns[along, other]
            moved = turns * np.repeat(periods[along], low.shape[2])[one]
        kept = (bottom[other] + moved < top[one]) & (top[other] + moved > bottom[one])
        one, other = one[kept], other[kept]
    return BoxPairs(one, other, around[:, one] + bins.turns[:, one] - bins.turns[:, other])
