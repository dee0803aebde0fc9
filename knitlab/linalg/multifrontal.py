"""Multifrontal sparse Cholesky factorisation, from the symbolic factorisation by nested dissection.

A matrix that is not positive definite can be convexified during the factorisation: the pivots of a
front that is not positive definite are replaced by the matrix with the same eigenvectors and the
absolute eigenvalues. This changes the matrix only in directions of negative curvature.

The halves of the sheet, on either side of the last separator, are independent: two threads
factorise them at the same time, as SciPy's BLAS and LAPACK release the global interpreter lock. The
result does not depend on the threads.

Matrices are in Fortran order, and those that BLAS overwrites are contiguous, because SciPy would
otherwise overwrite a copy. Only the lower triangle of a symmetric or triangular matrix is read.
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
"""Size up to which a triangular matrix is inverted rather than solved with: OpenBLAS multiplies
small matrices several times faster than it solves with them."""
LEAST_CURVATURE = 1e-6
"""Lower bound of the eigenvalues of a convexified front."""
WORTH_SHARING = 10**6
"""Entries of a factor above which a second thread pays off."""


Matrix = Float[np.ndarray, "_ _"]
Pivots = Float[np.ndarray, "pivot pivot"]
Coupling = Float[np.ndarray, "boundary pivot"]
Vector = Float[np.ndarray, " _"]


class Multifrontal:
    """Numeric factorisation of matrices of one sparsity, in memory that is reused.

    Allocating new memory for every factor of a large matrix would take as long as the
    factorisation.

    Args:
        plan: symbolic factorisation of the matrices.
        threads: threads to use, at most two.
    """

    def __init__(self, plan: NestedDissection, threads: Threads = ALONE) -> None:
        self.plan = plan
        self._threads = threads if plan.stored > WORTH_SHARING else ALONE
        self._stored = np.empty(plan.stored)
        self._solution, beside = np.zeros(len(plan.order)), np.zeros(len(plan.order))
        self._failed = Event()
        memory = _Memory(self._stored, np.empty(plan.stack), self._failed)
        vectors = self._solution, beside, self._solution
        self._parts = [
            _Part(fronts, memory, vector)
            for fronts, vector in zip(plan.parts, vectors, strict=True)
        ]

    def columns(self) -> Iterator[Columns]:
        """The columns of L of every front: its pivots and their coupling to its boundary.

        Entries above the diagonal of the pivots are undefined.
        """
        return (front.columns(self._stored) for part in self.plan.parts for front in part)

    def factorise(self, entries: Float[np.ndarray, " nonzero"], convexified: bool = False) -> bool:
        """Factorise a matrix and return whether it succeeded; this overwrites the previous factor.

        Args:
            entries: non-zeros of its lower triangle, in the order of the sparsity.
            convexified: whether to factorise a nearby positive definite matrix instead of failing;
                this fails only if the matrix is not finite.
        """
        self._stored[:] = 0
        self._stored[self.plan.places] = entries
        self._failed.clear()
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
    """Memory of factors and updates.

    Attributes:
        stored: memory for the columns of the factor.
        stack: memory for updates that are not yet added to their parents.
        failed: set when some pivots are not positive definite, so that both halves stop.
    """

    stored: Float[np.ndarray, " entry"]
    stack: Float[np.ndarray, " place"]
    failed: Event


@dataclass(frozen=True, eq=False)
class _Elimination:
    """Memory in which a front is eliminated.

    Attributes:
        pivots: its pivots, overwritten by their factor.
        coupling: coupling of boundary and pivots, overwritten by the rows of the factor.
        update: its update for its parent.
        taken: target and source of the extend-add of each block of its children's updates.
    """

    pivots: Pivots
    coupling: Coupling
    update: Float[np.ndarray, "boundary boundary"]
    taken: Sequence[tuple[Matrix, Matrix]]


@dataclass(frozen=True, eq=False)
class _Substitution:
    """Memory in which the triangular solves of a front work.

    Attributes:
        pivots: factor of its pivots.
        coupling: rows of the factor of its boundary.
        own: its pivots in the solution.
        boundary: unknowns that its pivots are coupled to.
        work: work array for these.
    """

    pivots: Pivots
    coupling: Coupling
    own: Float[np.ndarray, " pivot"]
    boundary: Int[np.ndarray, " boundary"]
    work: Float[np.ndarray, " boundary"]


class _Part:
    """Fronts that are eliminated one after another.

    Attributes:
        own: their pivots.
        vector: memory of the solution.
    """

    def __init__(self, fronts: Sequence[Front], memory: _Memory, vector: Vector) -> None:
        self.own = slice(fronts[0].pivots.start, fronts[-1].pivots.stop) if fronts else slice(0)
        self.vector, self._failed = vector, memory.failed
        widest = max((len(front.boundary) for front in fronts), default=0)
        self._inverted, work = np.empty(INVERTED_SIZE**2), np.empty(widest)
        self._eliminations = [_elimination(front, memory) for front in fronts]
        self._substitutions = [
            _Substitution(
                *front.columns(memory.stored),
                vector[front.pivots],
                front.boundary,
                work[: len(front.boundary)],
            )
            for front in fronts
        ]

    def factorise(self, convexified: bool) -> bool:
        """Factorise the fronts; returns whether they were positive definite, or were made so."""
        for front in self._eliminations:
            if self._failed.is_set():
                return False
            front.update[:] = 0
            for target, source in front.taken:
                np.add(target, source, out=target)
            before = front.pivots.copy(order="F") if convexified else None
            if not _factored(front.pivots) and (
                before is None or not _convexified(front.pivots, before)
            ):
                self._failed.set()
                return False
            if len(front.coupling):
                _multiply_by_inverse(front.coupling, front.pivots, self._inverted)
                dsyrk(-1.0, front.coupling, 1.0, front.update, lower=1, overwrite_c=1)
        return True

    def reduce(self) -> None:
        """Forward substitution, front by front."""
        for front in self._substitutions:
            dtrsv(front.pivots, front.own, lower=1, overwrite_x=1)
            if len(front.work):
                dgemv(1.0, front.coupling, front.own, 0.0, front.work, overwrite_y=1)
                self.vector[front.boundary] -= front.work

    def substitute_back(self) -> None:
        """Back substitution, the last front first."""
        for front in reversed(self._substitutions):
            if len(front.work):
                np.take(self.vector, front.boundary, out=front.work)
                dgemv(-1.0, front.coupling, front.work, 1.0, front.own, trans=1, overwrite_y=1)
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
    """Replace pivots by their Cholesky factor; returns whether they were positive definite."""
    _, failed = dpotrf(pivots, lower=1, clean=0, overwrite_a=1)
    # LAPACK may not report NaNs, which spread to all later pivots.
    return not failed and isfinite(pivots[-1, -1])


def _convexified(pivots: Pivots, before: Pivots) -> bool:
    """Replace pivots by the factor of their convexified values ``before`` the factorisation."""
    if not np.isfinite(before).all():
        return False
    # NumPy's function releases the global interpreter lock.
    values, vectors = np.linalg.eigh(before)
    pivots[:] = (vectors * np.maximum(np.abs(values), LEAST_CURVATURE)) @ vectors.T
    return _factored(pivots)


def _multiply_by_inverse(coupling: Coupling, triangle: Pivots, inverted: Vector) -> None:
    """``coupling`` ← coupling × triangle⁻ᵀ."""
    size = len(triangle)
    if size <= INVERTED_SIZE:
        inverse = inverted[: size * size].reshape(size, size).T
        inverse[:] = triangle
        dtrtri(inverse, lower=1, overwrite_c=1)
        dtrmm(1.0, inverse, coupling, side=1, lower=1, trans_a=1, overwrite_b=1)
        return
    half = size // 2
    first, second = coupling[:, :half], coupling[:, half:]
    _multiply_by_inverse(first, triangle[:half, :half], inverted)
    dgemm(-1.0, first, triangle[half:, :half], 1.0, second, trans_b=1, overwrite_c=1)
    _multiply_by_inverse(second, triangle[half:, half:], inverted)
