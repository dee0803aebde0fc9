"""Nested dissection of a grid: the elimination order of its nodes.

The grid is bisected recursively by separators: lines of nodes as thick as the couplings are long.
A separator is eliminated after the parts on either side. Periodic directions are cut twice.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

LEAF_NODES = 32
"""Nodes up to which a rectangle of the grid is not bisected; larger leaves mean fewer BLAS calls
with more work in each."""


@dataclass(frozen=True, eq=False)
class EliminationAxis:
    """One axis of the grid.

    Attributes:
        line: line of every unknown, from 0; negative for unknowns of the whole grid.
        lines: number of lines.
        ring: whether the last line is coupled to the first.
        reach: number of lines over which unknowns are coupled; the thickness of a separator.
    """

    line: Int[np.ndarray, " unknown"]
    lines: int
    ring: bool
    reach: int

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


def grid_axis(
    line: Int[np.ndarray, " unknown"],
    nodal: Int[np.ndarray, " nodal"],
    distance: Int[np.ndarray, " coupling"],
) -> EliminationAxis:
    """An axis, from the lines of its unknowns.

    Args:
        line: line of every unknown; negative for unknowns of the whole grid.
        nodal: lines of the other unknowns.
        distance: number of lines between the two unknowns of every coupling.
    """
    first, last = nodal.min(), nodal.max()
    lines = int(last - first) + 1
    ring = bool((distance > lines / 2).any())
    across = np.minimum(distance, lines - distance) if ring else distance
    return EliminationAxis(line - first, lines, ring, max(1, int(across.max())))


_Rectangle = tuple[int, int, int, int]


def elimination_order(
    vertical: EliminationAxis, horizontal: EliminationAxis
) -> tuple[Int[np.ndarray, " unknown"], Int[np.ndarray, " unknown"]]:
    """Front of every unknown, children before parents, and its sort key within the front."""
    label = np.zeros((vertical.lines, horizontal.lines), dtype=np.int64)
    # Numbered along a separator, so that neighbours of a segment are contiguous: fewer blocks.
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
            # The two separators of a ring are numbered one after the other, not alternately.
            key[part] = along[part] + place * label.size
    nodal = vertical.line >= 0
    node = vertical.line[nodal], horizontal.line[nodal]
    labels, keys = np.full(len(nodal), label.max()), np.full(len(nodal), 2 * label.size)
    labels[nodal], keys[nodal] = label[node], key[node]
    return labels, keys


def _dissected(
    region: _Rectangle, vertical: EliminationAxis, horizontal: EliminationAxis
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
