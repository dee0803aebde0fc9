"""Solves with a multifrontal factor, also after a few entries of the diagonal have changed.

A call of BLAS for each small front would take longer than its arithmetic: fronts of one level and
size are solved together, by batched matrix products. The two independent halves may be solved at
the same time; the result does not depend on the threads.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from jaxtyping import Float, Int

from knitlab.model.threads import ALONE, Threads
from knitlab.solvers.factorisation import blas
from knitlab.solvers.factorisation.blas import Vector
from knitlab.solvers.factorisation.symbolic_factorisation import (
    Front,
    NestedDissection,
    columns_of_group,
)

MIN_GROUP = 4  # number of fronts from which a group pays off
WORTH_SHARING = 3 * 10**7  # entries of a factor above which a second thread pays off in a solve

Positions = Int[np.ndarray, " _"]


class FrontSolves:
    """Triangular solves of one front, in place in a vector in elimination order."""

    def __init__(self, front: Front, boundary: Positions, stored: Vector, vector: Vector) -> None:
        pivots, coupling = front.columns(stored)
        own = vector[front.pivots]
        self._work = np.empty(len(boundary), vector.dtype)
        self._vector = vector
        self._boundary = boundary
        apply = blas.multiply_by_triangle if front.inverted else blas.solve
        self._forward = [apply(pivots, own)]
        self._back = [apply(pivots, own, transposed=True)]
        if len(boundary):
            self._forward.append(blas.multiply(self._work, coupling, own))
            self._back.insert(0, blas.subtract_transposed_product(own, coupling, self._work))

    def reduce(self) -> None:
        """Forward substitution."""
        blas.run(self._forward)
        if len(self._work):
            self._vector[self._boundary] -= self._work

    def substitute_back(self) -> None:
        """Back substitution."""
        if len(self._work):
            np.take(self._vector, self._boundary, out=self._work, mode="clip")
        blas.run(self._back)


class GroupSolves:
    """Triangular solves of fronts of one level and size, which are stored one after another."""

    def __init__(
        self,
        fronts: Sequence[Front],
        boundaries: Sequence[Positions],
        stored: Vector,
        vector: Vector,
    ) -> None:
        starts = np.array([front.pivots.start for front in fronts])
        self._pivots = starts[:, None] + np.arange(fronts[0].size)
        self._vector = vector
        self._boundary = np.stack(boundaries)
        self._inverses, self._couplings = columns_of_group(fronts, stored)

    def reduce(self) -> None:
        """Forward substitution."""
        own = self._inverses @ self._vector[self._pivots][..., None]
        self._vector[self._pivots] = own[..., 0]
        # Several fronts may share an unknown of their boundaries.
        np.subtract.at(self._vector, self._boundary.ravel(), (self._couplings @ own).ravel())

    def substitute_back(self) -> None:
        """Back substitution."""
        known = self._vector[self._boundary][..., None]
        own = self._vector[self._pivots][..., None] - self._couplings.transpose(0, 2, 1) @ known
        self._vector[self._pivots] = (self._inverses.transpose(0, 2, 1) @ own)[..., 0]


def _reduce(solves: list[FrontSolves | GroupSolves]) -> None:
    for each in solves:
        each.reduce()


def _substitute_back(solves: list[FrontSolves | GroupSolves]) -> None:
    for each in reversed(solves):
        each.substitute_back()


class TriangularSolves:
    """Solves with the factor L of a matrix, whose columns may be overwritten between solves."""

    def __init__(self, plan: NestedDissection, stored: Vector, threads: Threads = ALONE) -> None:
        self._order = plan.order
        self._stored = stored
        self._threads = threads if plan.stored > WORTH_SHARING else ALONE
        first, second, (last,) = plan.parts
        self._fronts = [*first, *second, last]
        self._starts = np.array([front.pivots.start for front in self._fronts])
        # Both halves subtract from the pivots of the last front, the second half from a copy.
        size = len(plan.order)
        self._vector = np.zeros(size + last.size, stored.dtype)
        self._solution, self._copy = np.split(self._vector, [size])
        self._shared = self._solution[last.pivots]
        self._boundaries = [front.boundary for front in self._fronts]
        middle = len(first)
        end = len(first) + len(second)
        for number in range(middle, end):
            boundary = self._boundaries[number]
            self._boundaries[number] = boundary + last.size * (boundary >= last.pivots.start)
        self._single: dict[int, FrontSolves] = {}
        halves = range(middle), range(middle, end)
        self._halves = [list(self._half_solves(numbers)) for numbers in halves]
        self.restart()

    def restart(self) -> None:
        """Forget the changes of the diagonal; the factor has been overwritten."""
        self._update: tuple[Positions, Float[np.ndarray, "row changed"], np.ndarray] | None = None
        self._columns: dict[int, tuple[Positions, Vector]] = {}

    def solve(self, rhs: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        """The x of matrix × x = ``rhs``, with the changes of the diagonal, if any."""
        self._solution[:] = rhs[self._order]
        self._copy[:] = 0
        self._threads.each(_reduce, self._halves)
        last = len(self._fronts) - 1
        self._reduce_one(last)
        if self._update is not None:
            rows, columns, weights = self._update
            reduced = self._solution[rows]
            self._solution[rows] = reduced - columns @ (weights @ (columns.T @ reduced))
        self._single_solves(last).substitute_back()
        self._copy[:] = self._shared
        self._threads.each(_substitute_back, self._halves)
        solved = np.empty(rhs.shape)
        solved[self._order] = self._solution
        return solved

    def change_diagonal(
        self, unknowns: Int[np.ndarray, " changed"], changes: Float[np.ndarray, " changed"]
    ) -> bool:
        """Change entries of the diagonal for the next solves; changes, not 0, replace earlier ones.

        With W = L⁻¹ E for the changed unknowns E and their changes K, L Lᵀ + E K Eᵀ = L (I + W K
        Wᵀ) Lᵀ, so that a solve only has to apply (I + W K Wᵀ)⁻¹ between forward and back
        substitution (Woodbury). Returns whether the changed matrix is positive definite; if not,
        nothing changes.
        """
        self._update = None
        if not len(unknowns):
            return True
        columns = [self._column(unknown) for unknown in unknowns.tolist()]
        rows = np.unique(np.concatenate([own for own, _ in columns]))
        dense = np.zeros((len(rows), len(columns)), self._solution.dtype, order="F")
        for target, (own, values) in zip(dense.T, columns, strict=True):
            target[np.searchsorted(rows, own)] = values
        square = dense.T.astype(float) @ dense
        if not np.isfinite(square).all():
            return False
        values, vectors = np.linalg.eigh(square)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        # Its eigenvalues are those of I + W K Wᵀ that are not 1.
        small = np.eye(len(changes)) + root.T @ (changes[:, None] * root)
        if not np.linalg.eigvalsh(small)[0] > 1e-6:
            return False
        weights = np.linalg.inv(np.diag(1 / changes) + square)
        self._update = rows, dense, weights.astype(dense.dtype)
        return True

    def _column(self, unknown: int) -> tuple[Positions, Vector]:
        """L⁻¹ times an unknown's unit vector: rows, of its front and ancestors, and values."""
        if unknown not in self._columns:
            positions = np.flatnonzero(self._order == unknown)
            passed = list[Positions]()
            self._vector[:] = 0
            self._vector[positions] = 1
            while len(positions):
                number = int(np.searchsorted(self._starts, positions[0], side="right")) - 1
                self._reduce_one(number)
                pivots = self._fronts[number].pivots
                passed.append(np.arange(pivots.start, pivots.stop))
                # The front that its update is added to.
                positions = self._boundaries[number]
            rows = np.concatenate(passed)
            self._columns[unknown] = rows, self._solution[rows]
        return self._columns[unknown]

    def _reduce_one(self, number: int) -> None:
        if number == len(self._fronts) - 1:
            self._shared += self._copy
        self._single_solves(number).reduce()

    def _half_solves(self, numbers: range) -> Iterator[FrontSolves | GroupSolves]:
        """Solves of the fronts of a half, in groups if possible, lower levels first."""
        in_memory = sorted(numbers, key=lambda number: self._fronts[number].stored)
        for _, group in groupby(in_memory, key=lambda number: self._fronts[number].kind):
            members = list(group)
            fronts = [self._fronts[number] for number in members]
            if len(members) >= MIN_GROUP and fronts[0].inverted and len(fronts[0].boundary):
                boundaries = [self._boundaries[number] for number in members]
                yield GroupSolves(fronts, boundaries, self._stored, self._vector)
            else:
                yield from map(self._single_solves, members)

    def _single_solves(self, number: int) -> FrontSolves:
        if number not in self._single:
            front = self._fronts[number]
            boundary = self._boundaries[number]
            self._single[number] = FrontSolves(front, boundary, self._stored, self._vector)
        return self._single[number]
