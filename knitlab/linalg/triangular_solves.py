"""Solves with a multifrontal factor, also after a few entries of the diagonal have changed.

They use one thread: many short calls would wait for the interpreter lock longer than a second
thread saves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from knitlab.linalg import blas
from knitlab.linalg.blas import Call, Vector
from knitlab.linalg.diagonal_update import DiagonalUpdate
from knitlab.linalg.symbolic_factorisation import Front, NestedDissection

Rows = Int[np.ndarray, " row"]


class TriangularSolves:
    """Solves with the factor L of a matrix, in memory that is reused.

    Args:
        plan: symbolic factorisation of the matrix.
        stored: memory of the factor, whose columns may be overwritten between solves.
    """

    def __init__(self, plan: NestedDissection, stored: Vector) -> None:
        self._order = plan.order
        self._solution = np.zeros(len(plan.order), stored.dtype)
        fronts = [front for part in plan.parts for front in part]
        self._starts = np.array([front.pivots.start for front in fronts])
        work = np.empty(max((len(front.boundary) for front in fronts), default=0), stored.dtype)
        self._fronts = [_front_solves(front, stored, self._solution, work) for front in fronts]
        self._update: DiagonalUpdate | None = None
        self._columns: dict[int, tuple[Rows, Vector]] = {}

    def restart(self) -> None:
        """Forget the changes of the diagonal; the factor has been overwritten."""
        self._update, self._columns = None, {}

    def solve(self, rhs: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        """The x of matrix × x = ``rhs``, with the changes of the diagonal, if any."""
        self._solution[:] = rhs[self._order]
        for front in self._fronts:
            front.reduce()
        if self._update is not None:
            self._update.apply(self._solution)
        for front in reversed(self._fronts):
            front.substitute_back()
        solved = np.empty(rhs.shape)
        solved[self._order] = self._solution
        return solved

    def change_diagonal(
        self, unknowns: Int[np.ndarray, " changed"], changes: Float[np.ndarray, " changed"]
    ) -> bool:
        """Change entries of the diagonal of the factorised matrix for the next solves.

        This replaces earlier changes. It costs a few per cent of a solve for every unknown.

        Args:
            unknowns: the unknowns.
            changes: what is added to the entry of each; not 0.

        Returns:
            Whether the changed matrix is positive definite; if not, it is as it was factorised.
        """
        self._update = None
        if not len(unknowns):
            return True
        columns = [self._column(unknown) for unknown in unknowns.tolist()]
        rows = np.unique(np.concatenate([own for own, _ in columns]))
        dense = np.zeros((len(rows), len(columns)), self._solution.dtype, order="F")
        for target, (own, values) in zip(dense.T, columns, strict=True):
            target[np.searchsorted(rows, own)] = values
        self._update = DiagonalUpdate.of(rows, dense, changes)
        return self._update is not None

    def _column(self, unknown: int) -> tuple[Rows, Vector]:
        """L⁻¹ times the unit vector of an unknown: its rows that are not 0, and their values.

        These are the pivots of the unknown's front and of its ancestors.
        """
        if unknown not in self._columns:
            places, passed = np.flatnonzero(self._order == unknown), list[Rows]()
            self._solution[:] = 0
            self._solution[places] = 1
            while len(places):
                front = self._fronts[np.searchsorted(self._starts, places[0], side="right") - 1]
                front.reduce()
                passed.append(np.arange(front.pivots.start, front.pivots.stop))
                # The front that its update is added to.
                places = front.boundary
            rows = np.concatenate(passed)
            self._columns[unknown] = rows, self._solution[rows]
        return self._columns[unknown]


@dataclass(frozen=True, eq=False)
class _FrontSolves:
    """Triangular solves of a front, in place.

    Attributes:
        vector: the right-hand side of all fronts, then their solution.
        pivots: its pivots.
        boundary: unknowns that its pivots are coupled to.
        work: work array for these.
        forward: solves for the pivots; computes what this subtracts from the boundary, in ``work``.
        back: solves for the pivots, given the boundary in ``work``.
    """

    vector: Float[np.ndarray, " unknown"]
    pivots: slice
    boundary: Int[np.ndarray, " boundary"]
    work: Float[np.ndarray, " boundary"]
    forward: Sequence[Call]
    back: Sequence[Call]

    def reduce(self) -> None:
        """Forward substitution."""
        blas.run(self.forward)
        if len(self.work):
            self.vector[self.boundary] -= self.work

    def substitute_back(self) -> None:
        """Back substitution."""
        if len(self.work):
            np.take(self.vector, self.boundary, out=self.work)
        blas.run(self.back)


def _front_solves(front: Front, stored: Vector, vector: Vector, work: Vector) -> _FrontSolves:
    pivots, coupling = front.columns(stored)
    own, work = vector[front.pivots], work[: len(front.boundary)]
    forward, back = [blas.solve(pivots, own)], [blas.solve(pivots, own, transposed=True)]
    if len(work):
        forward.append(blas.multiply(work, coupling, own))
        back.insert(0, blas.subtract_transposed_product(own, coupling, work))
    return _FrontSolves(vector, front.pivots, front.boundary, work, forward, back)
