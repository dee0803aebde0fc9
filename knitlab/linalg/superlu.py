"""Factorisation of a symmetric positive definite matrix of any sparsity, by SuperLU."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.sparse.linalg import SuperLU, splu


@dataclass(frozen=True)
class GeneralFactors:
    """A factorised matrix."""

    factors: SuperLU

    def solve(self, right: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
        """The x of matrix × x = ``right``."""
        return self.factors.solve(right)


def factorise(matrix: sp.csc_array) -> GeneralFactors | None:
    """Factorise a matrix, or return ``None`` if it is not positive definite.

    The pivots stay on the diagonal, so that they are those of an LDLᵀ factorisation, whose signs
    are those of the eigenvalues (Sylvester's law of inertia).

    Args:
        matrix: symmetric, both triangles.
    """
    try:
        factors = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # a pivot is zero
        return None
    on_diagonal = np.array_equal(factors.perm_r, factors.perm_c)
    if not on_diagonal or not (factors.U.diagonal() > 0).all():
        return None
    return GeneralFactors(factors)
