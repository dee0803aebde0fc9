"""Multifrontal sparse Cholesky factorisation, from the symbolic factorisation by nested dissection.

A matrix that is not positive definite can be convexified: the pivots of a front that is not are
replaced by the matrix with the same eigenvectors and the absolute eigenvalues. Two threads
factorise the halves of the sheet, on either side of the last separator; the result does not depend
on the threads. It is faster here than CHOLMOD, PARDISO and SuperLU
(``benchmarks/bench_solvers.py``).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from threading import Event

import numpy as np
from jaxtyping import Float
from scipy.linalg import LinAlgError, eigh

from knitlab.model.threads import ALONE, Threads
from knitlab.solvers.factorisation import blas
from knitlab.solvers.factorisation.blas import Call, Matrix, Status, Vector
from knitlab.solvers.factorisation.symbolic_factorisation import (
    INVERTED_SIZE,
    Front,
    NestedDissection,
)
from knitlab.solvers.factorisation.triangular_solves import TriangularSolves

MIN_CURVATURE = 1e-6  # lower bound of the eigenvalues of a convexified front
WORTH_SHARING = 10**6  # entries of a factor above which a second thread pays off in a factorisation


class Multifrontal:
    """Numeric factorisation of matrices of one sparsity, in memory that is reused.

    Only one thread may factorise, solve or change the diagonal at a time; it uses at most two. In
    single precision, a matrix of larger condition number may be found not to be positive definite.
    """

    def __init__(
        self,
        plan: NestedDissection,
        threads: Threads = ALONE,
        precision: type[np.float32] | type[np.float64] = np.float64,
    ) -> None:
        self.plan = plan
        self._threads = threads if plan.stored > WORTH_SHARING else ALONE
        # Columns of the factor, and updates that are not yet added to their parents.
        self.stored = np.empty(plan.stored, precision)
        stack = np.empty(plan.stack, precision)
        self._failed = Event()
        self._parts = [_Part(fronts, self.stored, stack, self._failed) for fronts in plan.parts]
        self._solves = TriangularSolves(plan, self.stored, threads)
        self.solve = self._solves.solve
        self.change_diagonal = self._solves.change_diagonal

    def factorise(self, entries: Float[np.ndarray, " nonzero"], convexified: bool = False) -> bool:
        """Factorise a matrix, given its lower triangle, and return whether it succeeded.

        With ``convexified`` a nearby positive definite matrix is factorised instead of failing.
        """
        self._solves.restart()
        self.stored[:] = 0
        self.stored[self.plan.positions] = entries
        self._failed.clear()
        *halves, top = self._parts
        factored = self._threads.each(lambda half: half.factorise(convexified), halves)
        return all(factored) and top.factorise(convexified)


@dataclass(frozen=True, eq=False)
class _Elimination:
    pivots: Matrix  # overwritten by their factor, or by its inverse
    update: Matrix  # for its parent
    added: Sequence[tuple[Matrix, Matrix]]  # target and source of each extend-add from its children
    factorise: Call  # the pivots
    eliminate: Sequence[Call]  # the rows for its boundary, and the update


class _Part:
    """Fronts that are eliminated one after another, until one fails here or in the other half."""

    def __init__(
        self, fronts: Sequence[Front], stored: Vector, stack: Vector, failed: Event
    ) -> None:
        self._stored = stored
        self._stack = stack
        self._failed = failed
        self._status: Status = np.zeros(1, dtype=np.int32)
        self._inverse = np.empty(INVERTED_SIZE**2, stored.dtype)
        self._eliminations = [self._elimination(front) for front in fronts]

    def factorise(self, convexified: bool) -> bool:
        """Factorise the fronts; returns whether they were positive definite, or were made so."""
        for front in self._eliminations:
            if self._failed.is_set():
                return False
            front.update[:] = 0
            for target, source in front.added:
                np.add(target, source, out=target)
            before = front.pivots.copy(order="F") if convexified else None
            if not self._factored(front) and (
                before is None or not self._convexified(front, before)
            ):
                self._failed.set()
                return False
            blas.run(front.eliminate)
        return True

    def _factored(self, front: _Elimination) -> bool:
        """Replace pivots by their Cholesky factor; returns whether they were positive definite."""
        blas.run([front.factorise])
        # LAPACK may not report NaNs, which spread to all later pivots.
        return not self._status[0] and isfinite(front.pivots[-1, -1])

    def _convexified(self, front: _Elimination, before: Matrix) -> bool:
        """Replace pivots by the factor of their convexified values before the factorisation."""
        if not np.isfinite(before).all():
            return False
        # Few eigenvalues are negative, and all others remain. In single precision small ones would
        # not be found.
        below = -np.inf, MIN_CURVATURE
        try:
            values, vectors = eigh(before.astype(float), subset_by_value=below, check_finite=False)
        except LinAlgError:
            return False
        raised = np.maximum(np.abs(values), MIN_CURVATURE) - values
        # Above the diagonal, pivots that are inverted stay 0.
        front.pivots[:] = np.tril(before + (vectors * raised) @ vectors.T)
        return self._factored(front)

    def _elimination(self, front: Front) -> _Elimination:
        pivots, coupling = front.columns(self._stored)
        update = front.updated(self._stack)
        status = self._status
        targets = pivots, coupling, update
        added = [
            (targets[transfer.target][transfer.into], child.updated(self._stack)[transfer.block])
            for child, transfers in front.children
            for transfer in transfers
        ]
        eliminate: list[Call] = []
        if front.inverted:
            eliminate.append(blas.invert(pivots, status))
            eliminate.append(blas.multiply_by_transposed(coupling, pivots))
        elif len(front.boundary):
            eliminate += self._multiply_by_inverse(coupling, pivots)
        if len(front.boundary):
            eliminate.append(blas.subtract_square(update, coupling))
        return _Elimination(pivots, update, added, blas.cholesky(pivots, status), eliminate)

    def _multiply_by_inverse(self, coupling: Matrix, triangle: Matrix) -> Iterator[Call]:
        """``coupling`` ← coupling × triangle⁻ᵀ."""
        size = len(triangle)
        if size <= INVERTED_SIZE:
            inverse = self._inverse[: size * size].reshape(size, size).T
            yield blas.copy(inverse, triangle)
            yield blas.invert(inverse, self._status)
            yield blas.multiply_by_transposed(coupling, inverse)
            return
        half = size // 2
        first = coupling[:, :half]
        second = coupling[:, half:]
        yield from self._multiply_by_inverse(first, triangle[:half, :half])
        yield blas.subtract_product(second, first, triangle[half:, :half])
        yield from self._multiply_by_inverse(second, triangle[half:, half:])
