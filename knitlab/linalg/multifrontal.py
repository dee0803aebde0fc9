"""Sparse Cholesky factorisation, front by front, as nested dissection has planned it.

A matrix that is not positive definite can be convexified as it is factored: where a front is not,
its pivots are replaced by the matrix with the same eigenvectors and the absolute eigenvalues.
That adds to the matrix just where it curves down, and nothing elsewhere.

The halves of the sheet, on either side of the cut that is eliminated last, are independent: two
threads factor them at the same time, as SciPy's BLAS and LAPACK release the interpreter's lock.
Which thread does what changes no bit of it.

Matrices are in Fortran's order, and what BLAS overwrites is contiguous, else SciPy would overwrite
a copy. Only the lower triangle of a symmetric or triangular matrix is read.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from threading import Event

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg.blas import dgemm, dgemv, dsyrk, dtrmm, dtrsv
from scipy.linalg.lapack import dpotrf, dtrtri

from knitlab.linalg.symbolic_factorisation import Columns, Front, NestedDissection
from knitlab.linalg.threads import ALONE, Threads

INVERTED_SIZE = 48
"""Size up to which a triangle is inverted rather than solved with: OpenBLAS multiplies small
matrices several times faster than it solves with them."""
LEAST_CURVATURE = 1e-6
"""Floor of the absolute eigenvalues of a convexified front."""
WORTH_SHARING = 10**6
"""Entries of a factor above which a second thread brings more than it costs."""


Matrix = Float[np.ndarray, "_ _"]
Pivots = Float[np.ndarray, "pivot pivot"]
Coupling = Float[np.ndarray, "boundary pivot"]
Vector = Float[np.ndarray, " _"]


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
    """Where a front is eliminated.

    Attributes:
        pivots: its pivots, overwritten by their factor.
        coupling: its boundary with its pivots, overwritten by the factor's rows there.
        update: what it leaves to its parent.
        taken: where updates of its children are added, and these.
    """

    pivots: Pivots
    coupling: Coupling
    update: Float[np.ndarray, "boundary boundary"]
    taken: Sequence[tuple[Matrix, Matrix]]


@dataclass(frozen=True, eq=False)
class _Substitution:
    """Where a front is solved with.

    Attributes:
        pivots: factor of its pivots.
        coupling: the factor's rows of its boundary.
        own: its pivots in the solution.
        boundary: unknowns that its pivots are coupled to.
        there: memory for as many.
    """

    pivots: Pivots
    coupling: Coupling
    own: Float[np.ndarray, " pivot"]
    boundary: Int[np.ndarray, " boundary"]
    there: Float[np.ndarray, " boundary"]


class _Part:
    """Fronts that are eliminated one after the other.

    Attributes:
        own: their pivots.
        vector: where they are solved for.
    """

    def __init__(self, fronts: Sequence[Front], memory: _Memory, vector: Vector) -> None:
        self.own = slice(fronts[0].pivots.start, fronts[-1].pivots.stop) if fronts else slice(0)
        self.vector, self._hopeless = vector, memory.hopeless
        widest = max((len(front.boundary) for front in fronts), default=0)
        self._inverted, there = np.empty(INVERTED_SIZE**2), np.empty(widest)
        self._eliminations = [_elimination(front, memory) for front in fronts]
        self._substitutions = [
            _Substitution(
                *front.columns(memory.stored),
                vector[front.pivots],
                front.boundary,
                there[: len(front.boundary)],
            )
            for front in fronts
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
            if not _factored(front.pivots) and (
                before is None or not _convexified(front.pivots, before)
            ):
                self._hopeless.set()
                return False
            if len(front.coupling):
                _multiply_by_inverse(front.coupling, front.pivots, self._inverted)
                dsyrk(-1.0, front.coupling, 1.0, front.update, lower=1, overwrite_c=1)
        return True

    def reduce(self) -> None:
        """Solve for the pivots, front by front, as if nothing followed."""
        for front in self._substitutions:
            dtrsv(front.pivots, front.own, lower=1, overwrite_x=1)
            if len(front.there):
                dgemv(1.0, front.coupling, front.own, 0.0, front.there, overwrite_y=1)
                self.vector[front.boundary] -= front.there

    def substitute_back(self) -> None:
        """Take back from the pivots what follows them, the last front first."""
        for front in reversed(self._substitutions):
            if len(front.there):
                np.take(self.vector, front.boundary, out=front.there)
                dgemv(-1.0, front.coupling, front.there, 1.0, front.own, trans=1, overwrite_y=1)
            dtrsv(front.pivots, front.own, lower=1, trans=1, overwrite_x=1)


def _elimination(front: Front, memory: _Memory) -> _Elimination:
    targets = (*front.columns(memory.stored), front.updated(memory.stack))
    taken = [
        (targets[transfer.target][transfer.into], child.updated(memory.stack)[transfer.block])
        for child, transfers in front.children
        for transfer in transfers
    ]
    return _Elimination(*targets, taken)


def _factored(pivots: Pivots) -> bool:
    """Replace pivots by their Cholesky factor; whether they were positive definite."""
    _, failed = dpotrf(pivots, lower=1, clean=0, overwrite_a=1)
    # LAPACK may pass over what is no number, which spoils all pivots after it.
    return not failed and isfinite(pivots[-1, -1])


def _convexified(pivots: Pivots, before: Pivots) -> bool:
    """Replace pivots by the factor of what they were ``before``, made positive definite."""
    if not np.isfinite(before).all():
        return False
    # Of NumPy, whose functions release the interpreter's lock.
    values, vectors = np.linalg.eigh(before)
    pivots[:] = (vectors * np.maximum(np.abs(values), LEAST_CURVATURE)) @ vectors.T
    return _factored(pivots)


def _multiply_by_inverse(coupling: Coupling, triangle: Pivots, inverted: Vector) -> None:
    """``coupling`` ← coupling × triangle⁻ᵀ."""
    size = len(triangle)
    if size <= INVERTED_SIZE:
        here = inverted[: size * size].reshape(size, size).T
        here[:] = triangle
        dtrtri(here, lower=1, overwrite_c=1)
        dtrmm(1.0, here, coupling, side=1, lower=1, trans_a=1, overwrite_b=1)
        return
    half = size // 2
    first, second = coupling[:, :half], coupling[:, half:]
    _multiply_by_inverse(first, triangle[:half, :half], inverted)
    dgemm(-1.0, first, triangle[half:, :half], 1.0, second, trans_b=1, overwrite_c=1)
    _multiply_by_inverse(second, triangle[half:, half:], inverted)
