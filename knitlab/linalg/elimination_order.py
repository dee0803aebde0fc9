"""Nested dissection of a grid: in which order to eliminate its nodes.

The grid is cut in halves again and again by lines of nodes as thick as couplings reach, and the
cuts are eliminated after what lies beside them. Lines that close to a ring are cut twice.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

LEAF_NODES = 32
"""Nodes up to which a rectangle of the grid is not cut; a larger leaf means fewer calls of BLAS
and more work in each."""


@dataclass(frozen=True, eq=False)
class GridAxis:
    """One axis of the grid.

    Attributes:
        line: of every unknown, from 0; negative for those of the whole grid.
        lines: how many there are.
        ring: whether the last line is coupled to the first.
        reach: lines over which unknowns are coupled, so that a cut must be as thick.
    """

    line: Int[np.ndarray, " unknown"]
    lines: int
    ring: bool
    reach: int

    def closed(self, start: int, stop: int) -> bool:
        """Whether a stretch of lines goes all the way round."""
        return self.ring and stop - start == self.lines

    def halved(self, start: int, stop: int) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """The cuts that halve a stretch of lines, and the halves."""
        if self.closed(start, stop):
            middle = (start + stop) // 2
            first, second = (start, start + self.reach), (middle, middle + self.reach)
            return [first, second], [(first[1], middle), (second[1], stop)]
        middle = (start + stop - self.reach) // 2
        cut = (middle, middle + self.reach)
        return [cut], [(start, middle), (cut[1], stop)]


def grid_axis(
    line: Int[np.ndarray, " unknown"],
    nodal: Int[np.ndarray, " nodal"],
    distance: Int[np.ndarray, " coupling"],
) -> GridAxis:
    """An axis, from the lines that its unknowns lie on.

    Args:
        line: of every unknown; negative for those of the whole grid.
        nodal: of those that lie on one.
        distance: lines between the two unknowns of every coupling.
    """
    first, last = nodal.min(), nodal.max()
    lines = int(last - first) + 1
    ring = bool((distance > lines / 2).any())
    across = np.minimum(distance, lines - distance) if ring else distance
    return GridAxis(line - first, lines, ring, max(1, int(across.max())))


_Rectangle = tuple[int, int, int, int]


def elimination_order(
    vertical: GridAxis, horizontal: GridAxis
) -> tuple[Int[np.ndarray, " unknown"], Int[np.ndarray, " unknown"]]:
    """Number of every unknown's front, children before parents, and its key within it."""
    label = np.zeros((vertical.lines, horizontal.lines), dtype=np.int64)
    # Counted along a cut, what borders on a stretch of it is one run, and updates few blocks.
    along_rows = np.arange(label.size).reshape(label.shape)
    along_columns = np.arange(label.size).reshape(label.shape[::-1]).T
    key = np.zeros_like(label)
    for number, parts in enumerate(
        _dissected((0, vertical.lines, 0, horizontal.lines), vertical, horizontal)
    ):
        for place, (top, bottom, left, right) in enumerate(parts):
            part = slice(top, bottom), slice(left, right)
            label[part] = number
            along = along_columns if right - left > bottom - top else along_rows
            # The two cuts through a ring follow each other, lest their nodes alternate.
            key[part] = along[part] + place * label.size
    nodal = vertical.line >= 0
    node = vertical.line[nodal], horizontal.line[nodal]
    labels, keys = np.full(len(nodal), label.max()), np.full(len(nodal), 2 * label.size)
    labels[nodal], keys[nodal] = label[node], key[node]
    return labels, keys


def _dissected(
    region: _Rectangle, vertical: GridAxis, horizontal: GridAxis
) -> Iterator[Sequence[_Rectangle]]:
    """The leaves and cuts of a rectangle of the grid, in the order of elimination."""
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
