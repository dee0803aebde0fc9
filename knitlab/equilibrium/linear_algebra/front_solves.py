"""Triangular solves of fronts: of one front, and of a group of fronts of one level and size.

Most fronts are so small that a call of BLAS for each would take longer than its arithmetic. Fronts
of one level do not depend on each other, and in a sheet many of them have one size, so that batched
matrix products solve them together.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Int

from knitlab.equilibrium.linear_algebra import blas
from knitlab.equilibrium.linear_algebra.blas import Call, Vector
from knitlab.equilibrium.linear_algebra.symbolic_factorisation import Front, columns_of_group

Boundary = Int[np.ndarray, " boundary"]


class Solves(Protocol):
    """Triangular solves in place, in a vector in elimination order."""

    def reduce(self) -> None:
        """Forward substitution."""

    def substitute_back(self) -> None:
        """Back substitution."""


@dataclass(frozen=True, eq=False)
class FrontSolves:
    """Triangular solves of one front.

    Attributes:
        vector: the right-hand side of all fronts, then their solution.
        boundary: places, in it, that its pivots are coupled to.
        work: work array for these.
        forward: solves for the pivots; computes what this subtracts from the boundary, in ``work``.
        back: solves for the pivots, given the boundary in ``work``.
    """

    vector: Vector
    boundary: Boundary
    work: Float[np.ndarray, " boundary"]
    forward: Sequence[Call]
    back: Sequence[Call]

    @classmethod
    def of(cls, front: Front, boundary: Boundary, stored: Vector, vector: Vector) -> "FrontSolves":
        """The solves of a front.

        Args:
            front: the front.
            boundary: places of its boundary in the vector.
            stored: memory of the factor.
            vector: the vector.
        """
        pivots, coupling = front.columns(stored)
        own, work = vector[front.pivots], np.empty(len(boundary), vector.dtype)
        apply = blas.multiply_by_triangle if front.inverted else blas.solve
        forward, back = [apply(pivots, own)], [apply(pivots, own, transposed=True)]
        if len(work):
            forward.append(blas.multiply(work, coupling, own))
            back.insert(0, blas.subtract_transposed_product(own, coupling, work))
        return cls(vector, boundary, work, forward, back)

    def reduce(self) -> None:
        """Forward substitution."""
        blas.run(self.forward)
        if len(self.work):
            self.vector[self.boundary] -= self.work

    def substitute_back(self) -> None:
        """Back substitution."""
        if len(self.work):
            np.take(self.vector, self.boundary, out=self.work, mode="clip")
        blas.run(self.back)


@dataclass(frozen=True, eq=False)
class GroupSolves:
    """Triangular solves of fronts of one level and size, which are stored one after another.

    Attributes:
        vector: the right-hand side of all fronts, then their solution.
        pivots: places of the pivots in it.
        boundary: places of the boundaries.
        inverses: inverses of the factors of the pivots, upper triangles 0.
        couplings: rows of the factor for the boundaries.
    """

    vector: Vector
    pivots: Int[np.ndarray, "front pivot"]
    boundary: Int[np.ndarray, "front boundary"]
    inverses: Float[np.ndarray, "front pivot pivot"]
    couplings: Float[np.ndarray, "front boundary pivot"]

    @classmethod
    def of(
        cls,
        fronts: Sequence[Front],
        boundaries: Sequence[Boundary],
        stored: Vector,
        vector: Vector,
    ) -> "GroupSolves":
        """The solves of fronts that fit :func:`groupable`; arguments as for one front."""
        starts = np.array([front.pivots.start for front in fronts])
        pivots = starts[:, None] + np.arange(fronts[0].size)
        return cls(vector, pivots, np.stack(boundaries), *columns_of_group(fronts, stored))

    def reduce(self) -> None:
        """Forward substitution."""
        own = self.inverses @ self.vector[self.pivots][..., None]
        self.vector[self.pivots] = own[..., 0]
        # Several fronts may share an unknown of their boundaries.
        np.subtract.at(self.vector, self.boundary.ravel(), (self.couplings @ own).ravel())

    def substitute_back(self) -> None:
        """Back substitution."""
        known = self.vector[self.boundary][..., None]
        own = self.vector[self.pivots][..., None] - self.couplings.transpose(0, 2, 1) @ known
        self.vector[self.pivots] = (self.inverses.transpose(0, 2, 1) @ own)[..., 0]


def groupable(front: Front) -> bool:
    """Whether a front may be part of a group."""
    return front.inverted and len(front.boundary) > 0
