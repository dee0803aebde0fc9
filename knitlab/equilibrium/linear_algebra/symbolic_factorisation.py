"""Symbolic Cholesky factorisation on a grid of nodes, ordered by nested dissection.

The unknowns of one separator, or of one leaf, are eliminated together in a dense front. The grid
only determines the order; the couplings of a front follow from the sparsity, so that any symmetric
matrix is factorised correctly. Few couplings beyond those of the grid, such as contact of folded
plies, hardly add to the work; many would.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from knitlab.equilibrium.linear_algebra.elimination_order import GridOrder, nonzero_pairs

INVERTED_SIZE = 192
"""Size up to which the pivots of a front are stored as the inverse of their factor: OpenBLAS
multiplies by small matrices several times faster than it solves with them, and a group is solved by
products alone."""


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

    def updated(self, stack: Float[np.ndarray, " place"]) -> Float[np.ndarray, "boundary boundary"]:
        """View of its update."""
        boundary = len(self.boundary)
        return stack[self.update : self.update + boundary**2].reshape(boundary, boundary).T


def columns_of_group(
    fronts: Sequence[Front], stored: Float[np.ndarray, " entry"]
) -> tuple[Float[np.ndarray, "front pivot pivot"], Float[np.ndarray, "front boundary pivot"]]:
    """Views of pivots and couplings of fronts of one kind that are stored one after another."""
    count, (_, size, boundary) = len(fronts), fronts[0].kind
    start, length = fronts[0].stored, size * (size + boundary)
    columns = stored[start : start + count * length].reshape(count, length)
    # Every front is in Fortran order.
    pivots = columns[:, : size * size].reshape(count, size, size)
    couplings = columns[:, size * size :].reshape(count, size, boundary)
    return pivots.transpose(0, 2, 1), couplings.transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class NestedDissection:
    """Symbolic factorisation of matrices of one sparsity.

    Children are before parents; fronts of one half and one kind are stored one after another.
    """

    order: Int[np.ndarray, " unknown"]  # the unknowns as eliminated
    # two independent halves, and the last front
    parts: tuple[Sequence[Front], Sequence[Front], Sequence[Front]]
    places: Int[np.ndarray, " nonzero"]  # of lower non-zeros in the factor
    stored: int  # entries of the factor
    stack: int  # largest number of entries of pending updates


def planned(
    grid: GridOrder, indptr: Int[np.ndarray, " column"], indices: Int[np.ndarray, " nonzero"]
) -> NestedDissection:
    """Plan the factorisation of any lower triangle in the elimination order of a grid."""
    order, starts = grid.order, grid.starts
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    one, other = (rank[unknowns] for unknowns in nonzero_pairs(indptr, indices))
    column, row = np.minimum(one, other), np.maximum(one, other)
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
    places = stored[front] + within * sizes[front] + row - starts[front]
    boundary_keys = np.repeat(np.arange(len(sizes)), lengths) * len(order)
    boundary_keys += np.concatenate(boundaries)
    front, within = front[outside], within[outside]
    rank = np.searchsorted(boundary_keys, keys) - (np.cumsum(lengths) - lengths)[front]
    places[outside] = stored[front] + sizes[front] ** 2 + within * lengths[front] + rank
    parts = fronts[:middle], fronts[middle:-1], fronts[-1:]
    return NestedDissection(order, parts, places, int(entries.sum()), stack)


def _middle(parents: Int[np.ndarray, " front"], work: Int[np.ndarray, " front"]) -> int:
    """Where to split all fronts but the last into two independent halves of nearly equal work."""
    last = len(parents) - 1
    within = np.where(parents[:last] < last, parents[:last], -1)
    reached = np.maximum.accumulate(np.append(-1, within))
    places = np.flatnonzero(reached < np.arange(last + 1))
    done = np.append(0, np.cumsum(work[:last]))
    return int(places[np.abs(done[places] - done[-1] / 2).argmin()])


def _boundaries(
    keys: Int[np.ndarray, " coupling"],
    starts: Int[np.ndarray, " front"],
    owner: Int[np.ndarray, " unknown"],
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
    levels: Int[np.ndarray, " front"],
    stored: Int[np.ndarray, " front"],
    middle: int,
) -> tuple[tuple[Front, ...], int]:
    """The fronts with their offsets on the stack, and the size of the stack.

    The second half does not reuse the part of the first, which runs concurrently.
    """
    fronts: list[Front] = []
    waiting: list[Front] = []
    stack = bottom = 0
    children: list[list[Front]] = [[] for _ in boundaries]
    for number, (boundary, parent) in enumerate(zip(boundaries, parents, strict=True)):
        pivots = slice(int(starts[number]), int(starts[number + 1]))
        bottom = stack if number == middle else bottom
        update, size = bottom, len(boundary) ** 2
        for other in waiting:  # the lowest gap between pending updates
            if other.update >= bottom:
                if other.update - update >= size:
                    break
                update = other.update + len(other.boundary) ** 2
        extend_adds = tuple(
            (child, _extend_adds(child, pivots, boundary)) for child in children[number]
        )
        level, offset = int(levels[number]), int(stored[number])
        front = Front(pivots, boundary, level, offset, update, extend_adds)
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
    place = np.where(
        passed, np.searchsorted(boundary, child.boundary), child.boundary - pivots.start
    )
    breaks = np.flatnonzero((np.diff(place) != 1) | np.diff(passed)) + 1
    runs = [slice(*ends) for ends in pairwise([0, *breaks.tolist(), len(place)])]
    into = [slice(int(place[run.start]), int(place[run.stop - 1]) + 1) for run in runs]
    part = [int(passed[run.start]) for run in runs]
    return tuple(
        ExtendAdd(part[i] + part[j], (into[i], into[j]), (runs[i], runs[j]))
        for i in range(len(runs))
        for j in range(i + 1)
    )
