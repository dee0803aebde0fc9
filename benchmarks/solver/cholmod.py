"""CHOLMOD through the optional ``cvxopt`` (GPL), to compare knitlab's factorisation with."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from knitlab.equilibrium.factorisation import Entries, Factoriser
from knitlab.equilibrium.stiffness import FreeStiffness
from knitlab.equilibrium.system import System

SUPERNODAL = 2

Vector = Float[np.ndarray, " free"]


@dataclass(frozen=True)
class CholmodFactors:
    """The last factor.

    Attributes:
        solve: returns the matrix's inverse times a vector.
    """

    solve: Callable[[Vector], Vector]

    def change_diagonal(self, unknowns: Int[np.ndarray, " _"], changes: Vector) -> bool:
        """Nothing is changed."""
        return False


def cholmod_factoriser(free: FreeStiffness) -> Factoriser:
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

    factors = CholmodFactors(solve)

    def factorise(entries: Entries, convexified: bool = False) -> CholmodFactors | None:
        if not np.isfinite(entries).all():
            return None
        lower.V = matrix(entries)
        try:
            cholmod.numeric(lower, factor)
        except ArithmeticError:
            return None
        return factors

    return factorise


class CholmodSystem(System):
    """The equations of a fabric, factorised by CHOLMOD, always in double precision.

    Subdomains of a large sample are solved by knitlab's own factorisation. No matrix is
    convexified, nor any diagonal changed.
    """

    def new_factoriser(self, free: FreeStiffness, exact: bool) -> Factoriser:
        """CHOLMOD for the stiffness of these free unknowns."""
        return cholmod_factoriser(free)
