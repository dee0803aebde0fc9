"""Factorisation of a symmetric sparse matrix, and the test that it is positive definite."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu


def factorise(matrix: sp.csc_array) -> SuperLU | None:
    """Factor a symmetric matrix, or say by ``None`` that it is not positive definite.

    SuperLU is held to diagonal pivots, so that its U is D Lᵀ and, by Sylvester's law of
    inertia, has a positive diagonal just where the matrix is positive definite.
    """
    try:
        factors = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # an exactly zero pivot
        return None
    pivoted = not np.array_equal(factors.perm_r, factors.perm_c)
    return None if pivoted or factors.U.diagonal().min() <= 0 else factors
