"""Sparse Cholesky factorisation, front by front, as nested dissection has planned it.

A matrix that is not positive definite can be convexified as it is factored: where a front is not,
its pivots are replaced by the matrix with the same eigenvectors and the absolute eigenvalues.
That adds to the matrix just where it curves down, and nothing elsewhere.

The halves of the sheet, on either side of the cut that is eliminated last, know nothing of each
other: two threads factor them at the same time. Which thread does what changes no bit of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from threading import Event

import numpy as np
from jaxtyping import Float, Int

from knitlab.linalg.blas import (
    Call,
    Flag,
    Matrix,
    Vector,
    carry_out,
    cholesky,
    copied,
    inverse,
    minus_product,
    minus_square,
    minus_transposed_product,
    product,
    substituted,
    times_transposed,
)
from knitlab.linalg.symbolic_factorisation import Columns, Front, NestedDissection
from knitlab.linalg.threads import ALONE, Threads

INVERTED_SIZE = 48
"""Size up to which a triangle is inverted rather than solved with: OpenBLAS multiplies small
matrices several times faster than it solves with them."""
LEAST_CURVATURE = 1e-6
"""Floor of the absolute eigenvalues of a convexified front."""
WORTH_SHARING = 10**6
"""Entries of a factor above which a second thread brings more than it costs."""


class Multifrontal:
    """Memory of a factorisation, and what it does there, to be used again and again.

    New memory for every factor of a large matrix would take the system as long to provide as the
    factorisation itself.

    Args:
        plan: of the matrices to factor.
        threads: two are used.
    """

    def __init__(self, plan: NestedDissection, threads: Threads = ALONE) -> None:
        self.plan = plan
        self._threads = threads if plan.stored > WORTH_SHARING else ALONE
        self._stored = np.empty(plan.stored)
        self._solution, beside = np.zeros(len(plan.order)), np.zeros(len(plan.order))
        self._hopeless = Event()
        memory = _Memory(self._stored, np.empty(plan.stack), self._hopeless)
        vectors = self._solution, beside, self._solution
        self._parts = [
            _Part(fronts, memory, vector)
            for fronts, vector in zip(plan.parts, vectors, strict=True)
        ]

    def columns(self) -> Iterator[Columns]:
        """Of every front, L of its pivots and of their coupling to its boundary.

        What stands above the diagonal of the pivots means nothing.
        """
        return (front.columns(self._stored) for part in self.plan.parts for front in part)

    def factorise(self, entries: Float[np.ndarray, " nonzero"], convexified: bool = False) -> bool:
        """Factor a matrix, or say that it is not positive definite; the last factor is lost.

        Args:
            entries: of its lower triangle, in the order of the sparsity that was dissected.
            convexified: whether to factor, if it is not, a matrix nearby that is; it fails then
                only where the matrix is not finite.
        """
        self._stored[:] = 0
        self._stored[self.plan.places] = entries
        self._hopeless.clear()
        *halves, top = self._parts
        factored = self._threads.each(lambda half: half.factorise(convexified), halves)
        return all(factored) and top.factorise(convexified)

    def solve(self, rhs: Float[np.ndarray, "unknown *case"]) -> Float[np.ndarray, "unknown *case"]:
        """The x of matrix × x = ``rhs``, for every column of ``rhs`` if it has columns."""
        if rhs.ndim > 1:
            columns = [self.solve(column) for column in rhs.T]
            return np.stack(columns, axis=1) if columns else np.zeros(rhs.shape)
        first, second, top = self._parts
        beside, solution = second.vector, self._solution
        solution[:] = rhs[self.plan.order]
        beside[second.own], beside[top.own] = solution[second.own], 0.0
        self._threads.each(_Part.reduce, (first, second))
        solution[top.own] += beside[top.own]
        top.reduce()
        top.substitute_back()
        beside[top.own] = solution[top.own]
        self._threads.each(_Part.substitute_back, (first, second))
        solution[second.own] = beside[second.own]
        solved = np.empty_like(solution)
        solved[self.plan.order] = solution
        return solved


@dataclass(frozen=True, eq=False)
class _Memory:
    """Where factors and updates lie.

    Attributes:
        stored: for the columns of the factor.
        stack: for updates that wait for their parents.
        hopeless: set where some pivots are not positive definite, so that no part goes on.
    """

    stored: Float[np.ndarray, " entry"]
    stack: Float[np.ndarray, " place"]
    hopeless: Event


@dataclass(frozen=True, eq=False)
class _Elimination:
    """How a front is eliminated.

    Attributes:
        update: what it leaves to its parent.
        taken: where updates of its children are added, and these.
        pivots: its pivots.
        factor: their factorisation.
        eliminate: their coupling, multiplied by its inverse, and the update by that.
    """

    update: Matrix
    taken: Sequence[tuple[Matrix, Matrix]]
    pivots: Matrix
    factor: Call
    eliminate: Sequence[Call]


@dataclass(frozen=True, eq=False)
class _Substitution:
    """How a front is solved with.

    Attributes:
        boundary: unknowns that its pivots are coupled to.
        there: memory for as many.
        reduce: the pivots solved for, and what that leaves to the boundary ``there``.
        substitute_back: the pivots, from what of the boundary was solved for.
    """

    boundary: Int[np.ndarray, " boundary"]
    there: Vector
    reduce: Sequence[Call]
    substitute_back: Sequence[Call]


class _Part:
    """Fronts that are eliminated one after the other.

    Attributes:
        own: their pivots.
        vector: where they are solved for.
    """

    def __init__(self, fronts: Sequence[Front], memory: _Memory, vector: Vector) -> None:
        self.own = slice(fronts[0].pivots.start, fronts[-1].pivots.stop) if fronts else slice(0)
        self.vector, self._hopeless = vector, memory.hopeless
        self._failed = np.zeros(1, dtype=np.int32)
        widest = max((len(front.boundary) for front in fronts), default=0)
        inverted, there = np.empty(INVERTED_SIZE**2), np.empty(widest)
        self._eliminations = [
            _elimination(front, memory, inverted, self._failed) for front in fronts
        ]
        self._substitutions = [
            _substitution(front, front.columns(memory.stored), vector, there) for front in fronts
        ]

    def factorise(self, convexified: bool) -> bool:
        """Factor the fronts; whether they were positive definite, or were made so."""
        for front in self._eliminations:
            if self._hopeless.is_set():
                return False
            front.update[:] = 0
            for target, source in front.taken:
                np.add(target, source, out=target)
            before = front.pivots.copy(order="F") if convexified else None
            if not self._factored(front) and (
                before is None or not self._convexified(front, before)
            ):
                self._hopeless.set()
                return False
            carry_out(front.eliminate)
        return True

    def _factored(self, front: _Elimination) -> bool:
        carry_out([front.factor])
        # LAPACK may pass over what is no number, which spoils all pivots after it.
        return not self._failed[0] and isfinite(front.pivots[-1, -1])

    def _convexified(self, front: _Elimination, before: Matrix) -> bool:
        """Replace pivots by the factor of what they were, made positive definite."""
        if not np.isfinite(before).all():
            return False
        # Of NumPy, whose functions give the lock up.
        values, vectors = np.linalg.eigh(before)
        front.pivots[:] = (vectors * np.maximum(np.abs(values), LEAST_CURVATURE)) @ vectors.T
        return self._factored(front)

    def reduce(self) -> None:
        """Solve for the pivots, front by front, as if nothing followed."""
        for front in self._substitutions:
            carry_out(front.reduce)
            self.vector[front.boundary] -= front.there

    def substitute_back(self) -> None:
        """Take back from the pivots what follows them, the last front first."""
        for front in reversed(self._substitutions):
            np.take(self.vector, front.boundary, out=front.there)
            carry_out(front.substitute_back)


def _elimination(front: Front, memory: _Memory, inverted: Vector, failed: Flag) -> _Elimination:
    pivots, coupling = front.columns(memory.stored)
    update = front.updated(memory.stack)
    targets = (pivots, coupling, update)
    taken = [
        (targets[transfer.target][transfer.into], child.updated(memory.stack)[transfer.block])
        for child, transfers in front.children
        for transfer in transfers
    ]
    eliminate: list[Call] = []
    if len(front.boundary):
        eliminate += _times_inverse(coupling, pivots, inverted, failed)
        eliminate.append(minus_square(update, coupling))
    return _Elimination(update, taken, pivots, cholesky(pivots, failed), eliminate)


def _times_inverse(
    coupling: Matrix, triangle: Matrix, inverted: Vector, failed: Flag
) -> Iterator[Call]:
    """``coupling`` ← coupling × triangle⁻ᵀ."""
    size = len(triangle)
    if size <= INVERTED_SIZE:
        here = inverted[: size * size].reshape(size, size).T
        yield copied(here, triangle)
        yield inverse(here, failed)
        yield times_transposed(coupling, here)
        return
    half = size // 2
    first, second = coupling[:, :half], coupling[:, half:]
    yield from _times_inverse(first, triangle[:half, :half], inverted, failed)
    yield minus_product(second, first, triangle[half:, :half])
    yield from _times_inverse(second, triangle[half:, half:], inverted, failed)


def _substitution(front: Front, columns: Columns, vector: Vector, there: Vector) -> _Substitution:
    pivots, coupling = columns
    own, there = vector[front.pivots], there[: len(front.boundary)]
    reduce = [substituted(pivots, own)]
    back = [substituted(pivots, own, transposed=True)]
    if len(there):
        reduce.append(product(there, coupling, own))
        back.insert(0, minus_transposed_product(own, coupling, there))
    return _Substitution(front.boundary, there, reduce, back)
