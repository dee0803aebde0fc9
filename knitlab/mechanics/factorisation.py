"""Factorisation of the stiffness of the free unknowns, and the test that it is positive."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.linalg import SuperLU, splu

from knitlab.mechanics.assembly import Sparsity


@dataclass(frozen=True, eq=False)
class FreeStiffness:
    """Where the stiffness of the free unknowns lies within the full stiffness.

    Attributes:
        unknowns: places of the free unknowns, ascending.
        slots: non-zeros of the full matrix that couple free unknowns, column by column.
        indptr, indices: their own compressed-column sparsity.
        diagonal: which of the kept non-zeros lie on the diagonal.
    """

    unknowns: Int[np.ndarray, " free"]
    slots: Int[np.ndarray, " kept"]
    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " kept"]
    diagonal: Int[np.ndarray, " free"]

    @classmethod
    def of(cls, sparsity: Sparsity, unknowns: Int[np.ndarray, " free"]) -> "FreeStiffness":
        """Restrict a sparsity to the free unknowns."""
        size = len(sparsity.indptr) - 1
        numbers = np.arange(sparsity.nonzeros)
        numbered = sp.csc_array((numbers, sparsity.indices, sparsity.indptr), shape=(size, size))
        kept = numbered[unknowns][:, unknowns].tocsc()
        kept.sort_indices()
        columns = np.repeat(np.arange(len(unknowns)), np.diff(kept.indptr))
        diagonal = np.flatnonzero(kept.indices == columns)
        return cls(unknowns, kept.data, kept.indptr, kept.indices, diagonal)

    def matrix(self, stiffness: Float[np.ndarray, " nonzero"]) -> sp.csc_array:
        """Stiffness of the free unknowns [N/mm], picked from that of all."""
        entries = stiffness[self.slots]
        size = len(self.unknowns)
        return sp.csc_array((entries, self.indices, self.indptr), shape=(size, size))

    def shifted(self, matrix: sp.csc_array, shift: float) -> sp.csc_array:
        """``matrix`` plus ``shift`` times the identity [N/mm]."""
        entries = matrix.data.copy()
        entries[self.diagonal] += shift
        return sp.csc_array((entries, self.indices, self.indptr), shape=matrix.shape)


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
