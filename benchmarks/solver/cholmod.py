"""CHOLMOD through the optional ``cvxopt`` (GPL), to compare knitlab's factorisation with."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from knitlab.solvers.equilibrium.stiffness import FreeStiffness
from knitlab.solvers.equilibrium.system import System

SUPERNODAL = 2

Vector = Float[np.ndarray, " free"]


class CholmodFactors:
    """Factors matrices of one sparsity, like :class:`.Multifrontal`."""

    def __init__(self, free: FreeStiffness) -> None:
        from cvxopt import cholmod, spmatrix

        size = len(free.dofs)
        columns = np.repeat(np.arange(size), np.diff(free.indptr))
        self._lower = spmatrix(1.0, free.indices.tolist(), columns.tolist(), (size, size))
        cholmod.options["supernodal"] = SUPERNODAL
        self._factor = cholmod.symbolic(self._lower)

    def factorise(self, entries: Float[np.ndarray, " nonzero"], convexified: bool = False) -> bool:
        """Factorise a matrix; whether it is positive definite. None is convexified."""
        from cvxopt import cholmod, matrix

        if not np.isfinite(entries).all():
            return False
        self._lower.V = matrix(entries)
        try:
            cholmod.numeric(self._lower, self._factor)
        except ArithmeticError:
            return False
        return True

    def solve(self, right: Vector) -> Vector:
        """The matrix's inverse times a vector."""
        from cvxopt import cholmod, matrix

        solution = matrix(right)
        cholmod.solve(self._factor, solution)
        return np.array(solution).ravel()

    def change_diagonal(self, unknowns: Int[np.ndarray, " _"], changes: Vector) -> bool:
        """Nothing is changed."""
        return False


class CholmodSystem(System):
    """The equations of a fabric, factorised by CHOLMOD, always in double precision.

    Subdomains of a large sample are solved by knitlab's own factorisation. No matrix is
    convexified, nor any diagonal changed.
    """

    def new_factors(self, free: FreeStiffness, exact: bool) -> Any:
        """CHOLMOD for the stiffness of these free unknowns."""
        return CholmodFactors(free)
