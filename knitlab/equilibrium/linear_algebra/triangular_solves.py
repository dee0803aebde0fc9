"""Solves with a multifrontal factor, also after a few entries of the diagonal have changed.

The two independent halves may be solved at the same time, each by a thread of its own. The result
does not depend on the threads.
"""

from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np
from jaxtyping import Float, Int

from knitlab.equilibrium.linear_algebra.blas import Vector
from knitlab.equilibrium.linear_algebra.diagonal_update import DiagonalUpdate
from knitlab.equilibrium.linear_algebra.front_solves import (
    FrontSolves,
    GroupSolves,
    Solves,
    groupable,
)
from knitlab.equilibrium.linear_algebra.symbolic_factorisation import NestedDissection
from knitlab.fabric.threads import ALONE, Threads

LEAST_GROUP = 4
"""Number of fronts from which a group pays off."""
WORTH_SHARING = 3 * 10**7
"""Entries of a factor above which a second thread pays off in a solve."""

Rows = Int[np.ndarray, " row"]


class TriangularSolves:
    """Solves with the factor L of a matrix, in memory that is reused.

    Args:
        plan: symbolic factorisation of the matrix.
        stored: memory of the factor, whose columns may be overwritten between solves.
        threads: threads to use, at most two.
    """

    def __init__(self, plan: NestedDissection, stored: Vector, threads: Threads = ALONE) -> None:
        self._order, self._stored = plan.order, stored
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
        middle, end = len(first), len(first) + len(second)
        for number in range(middle, end):
            boundary = self._boundaries[number]
            self._boundaries[number] = boundary + last.size * (boundary >= last.pivots.start)
        halves = range(middle), range(middle, end)
        self._halves = [list(self._of_half(numbers)) for numbers in halves]
        self._single: dict[int, FrontSolves] = {}
        self._update: DiagonalUpdate | None = None
        self._columns: dict[int, tuple[Rows, Vector]] = {}

    def restart(self) -> None:
        """Forget the changes of the diagonal; the factor has been overwritten."""
        self._update, self._columns = None, {}

    def solve(self, rhs: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
        """The x of matrix × x = ``rhs``, with the changes of the diagonal, if any."""
        self._solution[:], self._copy[:] = rhs[self._order], 0
        self._threads.each(_reduce, self._halves)
        last = len(self._fronts) - 1
        self._reduce_one(last)
        if self._update is not None:
            self._update.apply(self._solution)
        self._solves_of_one(last).substitute_back()
        self._copy[:] = self._shared
        self._threads.each(_substitute_back, self._halves)
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
            self._vector[:] = 0
            self._vector[places] = 1
            while len(places):
                number = int(np.searchsorted(self._starts, places[0], side="right")) - 1
                self._reduce_one(number)
                pivots = self._fronts[number].pivots
                passed.append(np.arange(pivots.start, pivots.stop))
                # The front that its update is added to.
                places = self._boundaries[number]
            rows = np.concatenate(passed)
            self._columns[unknown] = rows, self._solution[rows]
        return self._columns[unknown]

    def _reduce_one(self, number: int) -> None:
        """Forward substitution of one front."""
        if number == len(self._fronts) - 1:
            self._shared += self._copy
        self._solves_of_one(number).reduce()

    def _of_half(self, numbers: range) -> Iterator[Solves]:
        """Solves of the fronts of a half, in groups if possible, lower levels first."""
        in_memory = sorted(numbers, key=lambda number: self._fronts[number].stored)
        for _, group in groupby(in_memory, key=lambda number: self._fronts[number].kind):
            members = list(group)
            fronts = [self._fronts[number] for number in members]
            if len(members) >= LEAST_GROUP and groupable(fronts[0]):
                boundaries = [self._boundaries[number] for number in members]
                yield GroupSolves.of(fronts, boundaries, self._stored, self._vector)
            else:
                yield from map(self._new_solves, members)

    def _solves_of_one(self, number: int) -> FrontSolves:
        if number not in self._single:
            self._single[number] = self._new_solves(number)
        return self._single[number]

    def _new_solves(self, number: int) -> FrontSolves:
        front, boundary = self._fronts[number], self._boundaries[number]
        return FrontSolves.of(front, boundary, self._stored, self._vector)


def _reduce(solves: Iterable[Solves]) -> None:
    for each in solves:
        each.reduce()


def _substitute_back(solves: list[Solves]) -> None:
    for each in reversed(solves):
        each.substitute_back()
