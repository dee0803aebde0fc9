"""Sparse Cholesky factorisation on a grid of nodes: multifrontal, ordered by nested dissection.

The grid is cut in halves again and again by lines of nodes as thick as couplings reach, and the
cuts are eliminated after what lies beside them. The unknowns of one cut, or of one leaf between
the cuts, are eliminated together in a dense front. The grid decides the order alone: what a
front is coupled to is read off the sparsity, so that any symmetric matrix is factored rightly,
and one that is no grid only slowly.

A matrix that is not positive definite can be convexified as it is factored: where a front is not,
its pivots are replaced by the matrix with the same eigenvectors and the absolute eigenvalues.
That adds to the matrix just where it curves down, and nothing elsewhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import eigh
from scipy.linalg.blas import dgemm, dsyrk, dtrmm, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf, dtrtri

from knitlab.mechanics.dissection import axis, places_in_order

INVERTED_SIZE = 48
"""Size up to which a triangle is inverted rather than solved with: OpenBLAS multiplies small
matrices several times faster than it solves with them."""
LEAST_CURVATURE = 1e-6
"""Floor of the absolute eigenvalues of a convexified front."""


Columns = tuple[Float[np.ndarray, "pivot pivot"], Float[np.ndarray, "boundary pivot"]]


@dataclass(frozen=True, eq=False)
class Transfer:
    """A block of a child's update, and where its parent takes it up.

    Attributes:
        target: 0 for the parent's pivots, 1 for its coupling, 2 for its own update.
        into: rows and columns there.
        block: rows and columns of the child's update.
    """

    target: int
    into: tuple[slice, slice]
    block: tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class Front:
    """Unknowns that are eliminated together, all numbered in the order of elimination.

    Attributes:
        pivots: the unknowns.
        boundary: later unknowns that their elimination couples to each other, ascending.
        stored: where its columns of the factor begin among those of all fronts.
        update: where its update, what it leaves to its parent, begins on the stack.
        children: fronts whose updates it takes up, and by which blocks.
    """

    pivots: slice
    boundary: Int[np.ndarray, " boundary"]
    stored: int
    update: int
    children: tuple[tuple["Front", tuple[Transfer, ...]], ...]

    @property
    def size(self) -> int:
        """Number of pivots."""
        return self.pivots.stop - self.pivots.start

    def columns(self, stored: Float[np.ndarray, " entry"]) -> Columns:
        """Views of its pivots and of their coupling to the boundary."""
        size, boundary = self.size, len(self.boundary)
        middle = self.stored + size * size
        pivots = stored[self.stored : middle].reshape(size, size).T
        return pivots, stored[middle : middle + size * boundary].reshape(size, boundary).T

    def updated(self, stack: Float[np.ndarray, " place"]) -> Float[np.ndarray, "boundary boundary"]:
        """View of its update."""
        boundary = len(self.boundary)
        return stack[self.update : self.update + boundary**2].reshape(boundary, boundary).T


@dataclass(frozen=True, eq=False)
class Factors:
    """The Cholesky factor L of a matrix.

    Attributes:
        order: the unknowns in the order of elimination.
        fronts: in which they were eliminated, children before parents.
        columns: of every front, L of its pivots and of their coupling to its boundary. What
            stands above the diagonal of the pivots means nothing.
    """

    order: Int[np.ndarray, " unknown"]
    fronts: tuple[Front, ...]
    columns: tuple[Columns, ...]

    def solve(self, rhs: Float[np.ndarray, "unknown *case"]) -> Float[np.ndarray, "unknown *case"]:
        """The x of matrix × x = ``rhs``, for every column of ``rhs`` if it has columns."""
        work = np.array(rhs[self.order], dtype=np.float64, order="C")
        for front, (pivots, coupling) in zip(self.fronts, self.columns, strict=True):
            part = _substituted(pivots, work[front.pivots], transposed=False)
            work[front.pivots] = part
            work[front.boundary] -= coupling @ part
        for front, (pivots, coupling) in zip(
            reversed(self.fronts), reversed(self.columns), strict=True
        ):
            part = work[front.pivots] - coupling.T @ work[front.boundary]
            work[front.pivots] = _substituted(pivots, part, transposed=True)
        solution = np.empty_like(work)
        solution[self.order] = work
        return solution


class Workspace(NamedTuple):
    """Memory of a factorisation.

    Attributes:
        stored: for the columns of the factor.
        stack: for updates that wait for their parents.
    """

    stored: Float[np.ndarray, " entry"]
    stack: Float[np.ndarray, " place"]


@dataclass(frozen=True, eq=False)
class NestedDissection:
    """How matrices of one sparsity are factored.

    Attributes:
        order: the unknowns in the order of elimination.
        fronts: in which they are eliminated, children before parents.
        places: of every non-zero of the lower triangle, where it enters the factor.
        stored: entries that the factor takes.
        stack: entries of updates that wait for their parents, at most.
    """

    order: Int[np.ndarray, " unknown"]
    fronts: tuple[Front, ...]
    places: Int[np.ndarray, " nonzero"]
    stored: int
    stack: int

    def workspace(self) -> Workspace:
        """Memory that a factorisation takes, to be used again and again."""
        return Workspace(np.empty(self.stored), np.empty(self.stack))

    def factorise(
        self,
        entries: Float[np.ndarray, " nonzero"],
        convexified: bool = False,
        workspace: Workspace | None = None,
    ) -> Factors | None:
        """Factor a matrix, or say by ``None`` that it is not positive definite.

        Args:
            entries: of its lower triangle, in the order of the sparsity that was dissected.
            convexified: whether to factor, if it is not, a matrix nearby that is; ``None`` then
                says that it is not finite.
            workspace: where to; its last factors are lost. New memory by default, which for a
                large matrix takes the system as long to provide as the factorisation itself.
        """
        stored, stack = workspace or self.workspace()
        stored[:] = 0
        stored[self.places] = entries
        columns = tuple(front.columns(stored) for front in self.fronts)
        for front, (pivots, coupling) in zip(self.fronts, columns, strict=True):
            update = front.updated(stack)
            update[:] = 0
            targets = (pivots, coupling, update)
            for child, transfers in front.children:
                child_update = child.updated(stack)
                for transfer in transfers:
                    target = targets[transfer.target][transfer.into]
                    np.add(target, child_update[transfer.block], out=target)
            before = pivots.copy(order="F") if convexified else None
            if not _factored(pivots) and (before is None or not _convexified(before, pivots)):
                return None
            if len(front.boundary):
                _eliminate(pivots, coupling)
                dsyrk(-1.0, coupling, beta=1.0, c=update, lower=1, overwrite_c=1)
        return Factors(self.order, self.fronts, columns)


def _factored(pivots: Float[np.ndarray, "pivot pivot"]) -> bool:
    """Factor pivots in place; whether they are positive definite."""
    _, failed = dpotrf(pivots, lower=1, clean=0, overwrite_a=1)
    # LAPACK may pass over what is no number, which spoils all pivots after it.
    return not failed and isfinite(pivots[-1, -1])


def _convexified(
    before: Float[np.ndarray, "pivot pivot"], pivots: Float[np.ndarray, "pivot pivot"]
) -> bool:
    """Replace pivots by the factor of what they were, made positive definite; unless not finite."""
    if not np.isfinite(before).all():
        return False
    values, vectors = eigh(before, lower=True)
    pivots[:] = (vectors * np.maximum(np.abs(values), LEAST_CURVATURE)) @ vectors.T
    return _factored(pivots)


def _eliminate(
    triangle: Float[np.ndarray, "pivot pivot"], coupling: Float[np.ndarray, "boundary pivot"]
) -> None:
    """Multiply ``coupling`` in place by the inverse of the transposed lower triangle."""
    size = len(triangle)
    if size <= INVERTED_SIZE:
        inverse, _ = dtrtri(triangle, lower=1)
        dtrmm(1.0, inverse, coupling, side=1, lower=1, trans_a=1, overwrite_b=1)
        return
    half = size // 2
    first, second = coupling[:, :half], coupling[:, half:]
    _eliminate(triangle[:half, :half], first)
    dgemm(-1.0, first, triangle[half:, :half], trans_b=1, beta=1.0, c=second, overwrite_c=1)
    _eliminate(triangle[half:, half:], second)


def _substituted(
    triangle: Float[np.ndarray, "pivot pivot"],
    part: Float[np.ndarray, "pivot *case"],
    transposed: bool,
) -> Float[np.ndarray, "pivot *case"]:
    """``part`` multiplied by the inverse of the lower triangle, or of its transpose."""
    if part.ndim == 1:
        return dtrsv(triangle, part, lower=1, trans=transposed)
    return dtrsm(1.0, triangle, part.T, side=1, lower=1, trans_a=not transposed).T


def nested_dissection(
    indptr: Int[np.ndarray, " column"],
    indices: Int[np.ndarray, " nonzero"],
    rows: Int[np.ndarray, " unknown"],
    columns: Int[np.ndarray, " unknown"],
) -> NestedDissection:
    """Plan the factorisation of symmetric matrices on a grid of nodes.

    Args:
        indptr: where the columns of the lower triangle begin.
        indices: rows of its non-zeros, the diagonal among them, column after column.
        rows: of the grid, for every unknown; -1 for unknowns of the whole grid, which are
            eliminated last.
        columns: likewise.
    """
    lower = np.asarray(indices, dtype=np.int64)
    upper = np.repeat(np.arange(len(rows)), np.diff(indptr))
    nodal = rows >= 0
    between = (nodal[lower] & nodal[upper]).nonzero()
    vertical, horizontal = (
        axis(line, line[nodal], np.abs(line[lower] - line[upper])[between])
        for line in (rows, columns)
    )
    label, key = places_in_order(vertical, horizontal)
    order = np.lexsort((key, label))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    starts = np.append(np.flatnonzero(np.diff(label[order], prepend=-1)), len(order))
    return _plan(order, starts, rank[lower], rank[upper])


def _plan(
    order: Int[np.ndarray, " unknown"],
    starts: Int[np.ndarray, " front"],
    one: Int[np.ndarray, " nonzero"],
    other: Int[np.ndarray, " nonzero"],
) -> NestedDissection:
    """Plan fronts that end where the next starts, from the non-zeros between unknowns."""
    column, row = np.minimum(one, other), np.maximum(one, other)
    sizes = np.diff(starts)
    owner = np.repeat(np.arange(len(sizes)), sizes)
    front = owner[column]
    outside = row >= starts[front + 1]
    keys = front[outside] * len(order) + row[outside]
    boundaries, parents = _boundaries(np.unique(keys), starts, owner)
    fronts, stack = _fronts(starts, boundaries, parents)

    stored = np.array([front.stored for front in fronts])
    lengths = np.array([len(boundary) for boundary in boundaries])
    within = column - starts[front]
    places = stored[front] + within * sizes[front] + row - starts[front]
    boundary_keys = np.repeat(np.arange(len(sizes)), lengths) * len(order)
    boundary_keys += np.concatenate(boundaries)
    front, within = front[outside], within[outside]
    rank = np.searchsorted(boundary_keys, keys) - (np.cumsum(lengths) - lengths)[front]
    places[outside] = stored[front] + sizes[front] ** 2 + within * lengths[front] + rank
    return NestedDissection(order, fronts, places, int(sizes @ (sizes + lengths)), stack)


def _boundaries(
    keys: Int[np.ndarray, " coupling"],
    starts: Int[np.ndarray, " front"],
    owner: Int[np.ndarray, " unknown"],
) -> tuple[list[Int[np.ndarray, " boundary"]], list[int]]:
    """Boundary of every front, and the front that takes up its update; -1 if none."""
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
    starts: Int[np.ndarray, " front"],
    boundaries: Sequence[Int[np.ndarray, " boundary"]],
    parents: Sequence[int],
) -> tuple[tuple[Front, ...], int]:
    """The fronts, their places in the factor and on the stack, and the size of the stack."""
    fronts: list[Front] = []
    waiting: list[Front] = []
    stored = stack = 0
    children: list[list[Front]] = [[] for _ in boundaries]
    for number, (boundary, parent) in enumerate(zip(boundaries, parents, strict=True)):
        pivots = slice(int(starts[number]), int(starts[number + 1]))
        update = _first_gap(waiting, len(boundary) ** 2)
        taken = tuple((child, _transfers(child, pivots, boundary)) for child in children[number])
        front = Front(pivots, boundary, stored, update, taken)
        fronts.append(front)
        stored += front.size * (front.size + len(boundary))
        stack = max(stack, update + len(boundary) ** 2)
        waiting = [other for other in waiting if other not in children[number]]
        if parent >= 0:
            children[parent].append(front)
            waiting = sorted([*waiting, front], key=lambda other: other.update)
    return tuple(fronts), stack


def _first_gap(waiting: Sequence[Front], size: int) -> int:
    """Lowest place on the stack where an update fits in between those that wait."""
    end = 0
    for front in waiting:
        if front.update - end >= size:
            break
        end = front.update + len(front.boundary) ** 2
    return end


def _transfers(
    child: Front, pivots: slice, boundary: Int[np.ndarray, " boundary"]
) -> tuple[Transfer, ...]:
    """Blocks of the lower triangle of a child's update that are contiguous in its parent too."""
    passed = child.boundary >= pivots.stop
    place = np.where(
        passed, np.searchsorted(boundary, child.boundary), child.boundary - pivots.start
    )
    breaks = np.flatnonzero((np.diff(place) != 1) | np.diff(passed)) + 1
    runs = [slice(*ends) for ends in pairwise([0, *breaks.tolist(), len(place)])]
    into = [slice(int(place[run.start]), int(place[run.stop - 1]) + 1) for run in runs]
    part = [int(passed[run.start]) for run in runs]
    return tuple(
        Transfer(part[i] + part[j], (into[i], into[j]), (runs[i], runs[j]))
        for i in range(len(runs))
        for j in range(i + 1)
    )
