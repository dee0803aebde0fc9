"""Nested dissection of a grid: the elimination order of its nodes.

The grid is bisected recursively by separators: lines of nodes as thick as the couplings are long.
A separator is eliminated after the parts on either side. Periodic directions are cut twice.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

LEAF_NODES = 32
"""Nodes up to which a rectangle of the grid is not bisected; larger leaves mean fewer BLAS calls
with more work in each."""
_Rectangle = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class _Axis:
    """One axis of the grid; a ``ring`` has its last line coupled to the first."""

    first: int
    lines: int
    ring: bool
    reach: int  # lines over which unknowns are coupled, the thickness of a separator

    def closed(self, start: int, stop: int) -> bool:
        """Whether a range of lines is the full ring."""
        return self.ring and stop - start == self.lines

    def halved(self, start: int, stop: int) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """The separators that bisect a range of lines, and the halves."""
        if self.closed(start, stop):
            middle = (start + stop) // 2
            first, second = (start, start + self.reach), (middle, middle + self.reach)
            return [first, second], [(first[1], middle), (second[1], stop)]
        middle = (start + stop - self.reach) // 2
        cut = (middle, middle + self.reach)
        return [cut], [(start, middle), (cut[1], stop)]


class GridOrder(NamedTuple):
    """The unknowns of a grid in elimination order, and where fronts start in it, with its end."""

    order: Int[np.ndarray, " unknown"]
    starts: Int[np.ndarray, " front"]


def grid_order(
    indptr: Int[np.ndarray, " column"],
    indices: Int[np.ndarray, " nonzero"],
    rows: Int[np.ndarray, " unknown"],
    columns: Int[np.ndarray, " unknown"],
) -> GridOrder:
    """The elimination order for couplings of a grid of nodes.

    ``indptr`` and ``indices`` are compressed columns of the lower triangle, with its diagonal. Grid
    ``rows`` and ``columns`` are −1 for unknowns of the whole grid, which are eliminated last.
    """
    lower, upper = nonzero_pairs(indptr, indices)
    nodal = rows >= 0
    between = nodal[lower] & nodal[upper]
    vertical, horizontal = (
        _axis(line[nodal], np.abs(line[lower] - line[upper])[between]) for line in (rows, columns)
    )
    front = np.zeros((vertical.lines, horizontal.lines), dtype=np.int64)
    # Numbered along a separator, so that neighbours of a segment are contiguous: fewer blocks.
    along_rows = np.arange(front.size).reshape(front.shape)
    along_columns = np.arange(front.size).reshape(front.shape[::-1]).T
    key = np.zeros_like(front)
    whole = 0, vertical.lines, 0, horizontal.lines
    for number, rectangles in enumerate(_dissected(whole, vertical, horizontal)):
        for place, (top, bottom, left, right) in enumerate(rectangles):
            nodes = slice(top, bottom), slice(left, right)
            front[nodes] = number
            along = along_columns if right - left > bottom - top else along_rows
            # The two separators of a ring are numbered one after the other, not alternately.
            key[nodes] = along[nodes] + place * front.size
    node = rows[nodal] - vertical.first, columns[nodal] - horizontal.first
    fronts, keys = np.full(len(nodal), front.max()), np.full(len(nodal), 2 * front.size)
    fronts[nodal], keys[nodal] = front[node], key[node]
    order = np.lexsort((keys, fronts))
    starts = np.append(np.flatnonzero(np.diff(fronts[order], prepend=-1)), len(order))
    return GridOrder(order, starts)


def nonzero_pairs(
    indptr: Int[np.ndarray, " column"], indices: Int[np.ndarray, " nonzero"]
) -> tuple[Int[np.ndarray, " nonzero"], Int[np.ndarray, " nonzero"]]:
    """Row and column of every non-zero."""
    columns = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return np.asarray(indices, dtype=np.int64), columns


def _axis(line: Int[np.ndarray, " nodal"], distance: Int[np.ndarray, " coupling"]) -> _Axis:
    """An axis, from the lines of nodes and the number of lines between the ends of couplings."""
    first = int(line.min())
    lines = int(line.max()) - first + 1
    ring = bool((distance > lines / 2).any())
    across = np.minimum(distance, lines - distance) if ring else distance
    return _Axis(first, lines, ring, max(1, int(across.max())))


def _dissected(
    region: _Rectangle, vertical: _Axis, horizontal: _Axis
) -> Iterator[Sequence[_Rectangle]]:
    """The leaves and separators of a rectangle of the grid, in elimination order."""
    top, bottom, left, right = region
    height, width = bottom - top, right - left
    # A ring must be cut twice.
    down = height * (1 + horizontal.closed(left, right))
    across = width * (1 + vertical.closed(top, bottom))
    upright = down <= across
    lines = horizontal.halved(left, right) if upright else vertical.halved(top, bottom)
    if height * width <= LEAF_NODES or any(stop <= start for start, stop in lines[1]):
        yield [region]
        return
    cuts, halves = (
        [(top, bottom, *part) if upright else (*part, left, right) for part in parts]
        for parts in lines
    )
    for half in halves:
        yield from _dissected(half, vertical, horizontal)
    yield cuts
