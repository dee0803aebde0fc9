"""CHOLMOD through the optional ``cvxopt`` (GPL), to compare knitlab's factorisation with."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.elasticity.stiffness import FreeStiffness
from knitlab.linalg.threads import Threads
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.solvers.system import System

SUPERNODAL = 2

Vector = Float[np.ndarray, " free"]
Entries = Float[np.ndarray, " nonzero"]
Solution = Callable[[Vector], Vector]
"""Solves with the last factor."""


def cholmod_factoriser(free: FreeStiffness) -> Callable[[Entries], Solution | None]:
    """What factors matrices of one sparsity; ``None`` of one that is not positive definite."""
    from cvxopt import cholmod, matrix, spmatrix

    size = len(free.places)
    columns = np.repeat(np.arange(size), np.diff(free.indptr))
    lower = spmatrix(1.0, free.indices.tolist(), columns.tolist(), (size, size))
    cholmod.options["supernodal"] = SUPERNODAL
    factor = cholmod.symbolic(lower)

    def solve(right: Vector) -> Vector:
        solution = matrix(right)
        cholmod.solve(factor, solution)
        return np.array(solution).ravel()

    def factorise(entries: Entries) -> Solution | None:
        if not np.isfinite(entries).all():
            return None
        lower.V = matrix(entries)
        try:
            cholmod.numeric(lower, factor)
        except ArithmeticError:
            return None
        return solve

    return factorise


class CholmodSystem(System):
    """The equations of a fabric, factorised by CHOLMOD.

    Subdomains of a large sample are solved by knitlab's own factorisation. No matrix is
    convexified, nor any diagonal changed.

    Args:
        shape: mesh shape of the fabric.
        fabric: its numbers.
        threads: that share what CHOLMOD does not do.
    """

    def __init__(self, shape: MeshShape, fabric: Fabric, threads: Threads) -> None:
        super().__init__(shape, fabric, threads=threads)
        self._by_cholmod: dict[FreeStiffness, Callable[[Entries], Solution | None]] = {}
        self._solution: Solution | None = None

    def factorise(
        self,
        shift: float,
        convexified: bool,
        contact: sp.csc_array | None = None,
        exact: bool = False,
    ) -> bool:
        """Factorise the assembled stiffness plus a shift, in double precision."""
        free = self._free
        if free is None:
            raise RuntimeError("nothing is assembled")
        if free not in self._by_cholmod:
            self._by_cholmod[free] = cholmod_factoriser(free)
        self._solution = self._by_cholmod[free](free.shifted(self._entries, shift))
        return self._solution is not None

    def change_diagonal(self, places: Int[np.ndarray, " _"], changes: Vector) -> bool:
        """Nothing is changed."""
        return False

    def solve(self, right: Vector) -> Vector:
        """The stiffness's inverse times a vector."""
        if self._solution is None:
            raise RuntimeError("nothing is factorised")
        return self._solution(right)
