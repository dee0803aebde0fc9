"""Symbolic Cholesky factorisation on a grid of nodes, ordered by nested dissection.

The grid is bisected recursively by separators: lines of nodes as thick as the couplings are long,
eliminated after the parts on either side; periodic directions are cut twice. The grid only
determines the order; the couplings of a front follow from the sparsity, so that any symmetric
matrix is factorised correctly, with little more work for a few couplings by contact.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

LEAF_NODES = 32
"""Nodes up to which a rectangle of the grid is not bisected; larger leaves mean fewer BLAS calls
with more work in each."""
INVERTED_SIZE = 192
"""Size up to which the pivots of a front are stored as the inverse of their factor: OpenBLAS
multiplies by small matrices several times faster than it solves with them, and a group is solved by
products alone."""

_Rectangle = tuple[int, int, int, int]
Columns = Int[np.ndarray, " column"]
Nonzeros = Int[np.ndarray, " nonzero"]
OfFronts = Int[np.ndarray, " front"]
OfUnknowns = Int[np.ndarray, " unknown"]


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
            first = (start, start + self.reach)
            second = (middle, middle + self.reach)
            return [first, second], [(first[1], middle), (second[1], stop)]
        middle = (start + stop - self.reach) // 2
        cut = (middle, middle + self.reach)
        return [cut], [(start, middle), (cut[1], stop)]


class GridOrder(NamedTuple):
    """The unknowns of a grid in elimination order, and where fronts start in it, with its end."""

    order: OfUnknowns
    starts: OfFronts


def grid_order(
    indptr: Columns, indices: Nonzeros, rows: OfUnknowns, columns: OfUnknowns
) -> GridOrder:
    """The elimination order for couplings of a grid of nodes.

    Grid ``rows`` and ``columns`` are −1 for unknowns of the whole grid, which are eliminated last.
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
        for rank, (top, bottom, left, right) in enumerate(rectangles):
            nodes = slice(top, bottom), slice(left, right)
            front[nodes] = number
            along = along_columns if right - left > bottom - top else along_rows
            # The two separators of a ring are numbered one after the other, not alternately.
            key[nodes] = along[nodes] + rank * front.size
    node = rows[nodal] - vertical.first, columns[nodal] - horizontal.first
    fronts = np.full(len(nodal), front.max())
    keys = np.full(len(nodal), 2 * front.size)
    fronts[nodal] = front[node]
    keys[nodal] = key[node]
    order = np.lexsort((keys, fronts))
    starts = np.append(np.flatnonzero(np.diff(fronts[order], prepend=-1)), len(order))
    return GridOrder(order, starts)


def nonzero_pairs(indptr: Columns, indices: Nonzeros) -> tuple[Nonzeros, Nonzeros]:
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
    height = bottom - top
    width = right - left
    # A ring must be cut twice.
    down = height * (1 + horizontal.closed(left, right))
    across = width * (1 + vertical.closed(top, bottom))
    upright = down <= across
    lines = horizontal.halved(left, right) if upright else vertical.halved(top, bottom)
    if height * width <= LEAF_NODES or any(stop <= start for start, stop in lines[1]):
        yield [region]
        return
    cuts, halves = (
        [(top, bottom, *span) if upright else (*span, left, right) for span in spans]
        for spans in lines
    )
    for half in halves:
        yield from _dissected(half, vertical, horizontal)
    yield cuts


class ExtendAdd(NamedTuple):
    """Extend-add of a block of a child's update into its parent, by rows and columns of both."""

    target: int  # 0 for the parent's pivots, 1 for its coupling, 2 for its own update
    into: tuple[slice, slice]
    block: tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Front:
    """Unknowns that are eliminated together, numbered in elimination order."""

    pivots: slice  # the unknowns
    boundary: Int[np.ndarray, " boundary"]  # later unknowns that they couple, ascending
    level: int  # in the elimination tree: 0 for leaves, above that of any child
    stored: int  # offset of its columns in the stored factor
    update: int  # offset of its update on the stack
    children: tuple[tuple["Front", tuple[ExtendAdd, ...]], ...]

    @property
    def size(self) -> int:
        """Number of pivots."""
        return self.pivots.stop - self.pivots.start

    @property
    def kind(self) -> tuple[int, int, int]:
        """Its level, and its numbers of pivots and of boundary unknowns."""
        return self.level, self.size, len(self.boundary)

    @property
    def inverted(self) -> bool:
        """Whether the factor of its pivots is stored as its inverse."""
        return self.size <= INVERTED_SIZE

    def columns(
        self, stored: Float[np.ndarray, " entry"]
    ) -> tuple[Float[np.ndarray, "pivot pivot"], Float[np.ndarray, "boundary pivot"]]:
        """Views of its pivots and of their coupling to the boundary."""
        (pivots,), (coupling,) = columns_of_group([self], stored)
        return pivots, coupling

    def updated(self, stack: Float[np.ndarray, " entry"]) -> Float[np.ndarray, "boundary boundary"]:
        """View of its update."""
        boundary = len(self.boundary)
        return stack[self.update : self.update + boundary**2].reshape(boundary, boundary).T


def columns_of_group(
    fronts: Sequence[Front], stored: Float[np.ndarray, " entry"]
) -> tuple[Float[np.ndarray, "front pivot pivot"], Float[np.ndarray, "front boundary pivot"]]:
    """Views of pivots and couplings of fronts of one kind that are stored one after another."""
    count = len(fronts)
    (_, size, boundary) = fronts[0].kind
    start = fronts[0].stored
    length = size * (size + boundary)
    columns = stored[start : start + count * length].reshape(count, length)
    # Every front is in Fortran order.
    pivots = columns[:, : size * size].reshape(count, size, size)
    couplings = columns[:, size * size :].reshape(count, size, boundary)
    return pivots.transpose(0, 2, 1), couplings.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class NestedDissection:
    """Symbolic factorisation of matrices of one sparsity; children are before parents."""

    order: OfUnknowns  # the unknowns as eliminated
    parts: tuple[Sequence[Front], Sequence[Front], Sequence[Front]]  # two halves, and the last
    positions: Nonzeros  # of lower non-zeros in the factor
    stored: int  # entries of the factor
    stack: int  # largest number of entries of pending updates


def planned(grid: GridOrder, indptr: Columns, indices: Nonzeros) -> NestedDissection:
    """Plan the factorisation of any lower triangle in the elimination order of a grid."""
    order = grid.order
    starts = grid.starts
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    one, other = (rank[unknowns] for unknowns in nonzero_pairs(indptr, indices))
    column = np.minimum(one, other)
    row = np.maximum(one, other)
    sizes = np.diff(starts)
    owner = np.repeat(np.arange(len(sizes)), sizes)
    front = owner[column]
    outside = row >= starts[front + 1]
    keys = front[outside] * len(order) + row[outside]
    boundaries, parents = _boundaries(np.unique(keys), starts, owner)
    lengths = np.array([len(boundary) for boundary in boundaries])
    middle = _middle(np.array(parents), sizes * lengths**2)
    levels = np.zeros(len(parents), dtype=np.int64)
    for number, parent in enumerate(parents):
        if parent >= 0:
            levels[parent] = max(levels[parent], levels[number] + 1)
    half = np.searchsorted([middle, len(sizes) - 1], np.arange(len(sizes)), side="right")
    # Fronts of one half, level and size are stored one after another.
    in_memory = np.lexsort((lengths, sizes, levels, half))
    entries = sizes * (sizes + lengths)
    stored = np.empty_like(entries)
    stored[in_memory] = np.cumsum(entries[in_memory]) - entries[in_memory]
    fronts, stack = _fronts(starts, boundaries, parents, levels, stored, middle)

    within = column - starts[front]
    positions = stored[front] + within * sizes[front] + row - starts[front]
    boundary_keys = np.repeat(np.arange(len(sizes)), lengths) * len(order)
    boundary_keys += np.concatenate(boundaries)
    front = front[outside]
    within = within[outside]
    rank = np.searchsorted(boundary_keys, keys) - (np.cumsum(lengths) - lengths)[front]
    positions[outside] = stored[front] + sizes[front] ** 2 + within * lengths[front] + rank
    parts = fronts[:middle], fronts[middle:-1], fronts[-1:]
    return NestedDissection(order, parts, positions, int(entries.sum()), stack)


def _middle(parents: OfFronts, work: OfFronts) -> int:
    """Where to split all fronts but the last into two independent halves of nearly equal work."""
    last = len(parents) - 1
    within = np.where(parents[:last] < last, parents[:last], -1)
    reached = np.maximum.accumulate(np.append(-1, within))
    positions = np.flatnonzero(reached < np.arange(last + 1))
    done = np.append(0, np.cumsum(work[:last]))
    return int(positions[np.abs(done[positions] - done[-1] / 2).argmin()])


def _boundaries(
    keys: Int[np.ndarray, " coupling"], starts: OfFronts, owner: OfUnknowns
) -> tuple[list[Int[np.ndarray, " _"]], list[int]]:
    """Boundary of every front, and its parent; -1 if none."""
    fronts, unknowns = np.divmod(keys, len(owner))
    boundaries = np.split(unknowns, np.searchsorted(fronts, np.arange(1, len(starts) - 1)))
    parents = []
    for boundary in boundaries:
        parents.append(int(owner[boundary[0]]) if len(boundary) else -1)
        if len(boundary):
            parent = parents[-1]
            handed = boundary[np.searchsorted(boundary, starts[parent + 1]) :]
            boundaries[parent] = np.union1d(boundaries[parent], handed)
    return boundaries, parents


def _fronts(
    starts: Int[np.ndarray, " _"],
    boundaries: Sequence[Int[np.ndarray, " _"]],
    parents: Sequence[int],
    levels: OfFronts,
    stored: OfFronts,
    middle: int,
) -> tuple[tuple[Front, ...], int]:
    """The fronts, and the size of the stack, whose parts for concurrent halves are disjoint."""
    fronts: list[Front] = []
    waiting: list[Front] = []
    stack = bottom = 0
    children: list[list[Front]] = [[] for _ in boundaries]
    for number, (boundary, parent) in enumerate(zip(boundaries, parents, strict=True)):
        pivots = slice(int(starts[number]), int(starts[number + 1]))
        bottom = stack if number == middle else bottom
        update = bottom
        size = len(boundary) ** 2
        for other in waiting:  # the lowest gap between pending updates
            if other.update >= bottom:
                if other.update - update >= size:
                    break
                update = other.update + len(other.boundary) ** 2
        extend_adds = tuple(
            (child, _extend_adds(child, pivots, boundary)) for child in children[number]
        )
        places = int(levels[number]), int(stored[number]), update
        front = Front(pivots, boundary, *places, extend_adds)
        fronts.append(front)
        stack = max(stack, update + size)
        waiting = [other for other in waiting if other not in children[number]]
        if parent >= 0:
            children[parent].append(front)
            waiting = sorted([*waiting, front], key=lambda other: other.update)
    return tuple(fronts), stack


def _extend_adds(
    child: Front, pivots: slice, boundary: Int[np.ndarray, " boundary"]
) -> tuple[ExtendAdd, ...]:
    """Blocks of the lower triangle of a child's update that are also contiguous in its parent."""
    passed = child.boundary >= pivots.stop
    position = np.where(
        passed, np.searchsorted(boundary, child.boundary), child.boundary - pivots.start
    )
    breaks = np.flatnonzero((np.diff(position) != 1) | np.diff(passed)) + 1
    runs = [slice(*ends) for ends in pairwise([0, *breaks.tolist(), len(position)])]
    into = [slice(int(position[run.start]), int(position[run.stop - 1]) + 1) for run in runs]
    updates = [int(passed[run.start]) for run in runs]
    return tuple(
        ExtendAdd(updates[i] + updates[j], (into[i], into[j]), (runs[i], runs[j]))
        for i in range(len(runs))
        for j in range(i + 1)
    )
