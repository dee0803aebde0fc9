"""Low-rank update of a Cholesky factor, for changes of a few entries of the diagonal.

With W = L⁻¹ E for the changed unknowns E and their changes K, L Lᵀ + E K Eᵀ = L (I + W K Wᵀ) Lᵀ, so
that a solve only has to apply (I + W K Wᵀ)⁻¹ between forward and back substitution (Woodbury).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

LEAST_EIGENVALUE = 1e-6
"""Least eigenvalue of an update that counts as positive definite."""


@dataclass(frozen=True, eq=False)
class DiagonalUpdate:
    """A positive definite I + W K Wᵀ, ready to be applied.

    Attributes:
        rows: places, in elimination order, of the unknowns with non-zeros in W.
        columns: these rows of W.
        weights: (K⁻¹ + WᵀW)⁻¹, the inverse of the capacitance matrix.
    """

    rows: Int[np.ndarray, " row"]
    columns: Float[np.ndarray, "row changed"]
    weights: Float[np.ndarray, "changed changed"]

    @classmethod
    def of(
        cls,
        rows: Int[np.ndarray, " row"],
        columns: Float[np.ndarray, "row changed"],
        changes: Float[np.ndarray, " changed"],
    ) -> "DiagonalUpdate | None":
        """The update for changes of the diagonal; ``None`` if it is not positive definite."""
        square = columns.T.astype(float) @ columns
        if not np.isfinite(square).all():
            return None
        values, vectors = np.linalg.eigh(square)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        # Its eigenvalues are those of I + W K Wᵀ that are not 1.
        small = np.eye(len(changes)) + root.T @ (changes[:, None] * root)
        if not np.linalg.eigvalsh(small)[0] > LEAST_EIGENVALUE:
            return None
        weights = np.linalg.inv(np.diag(1 / changes) + square)
        return cls(rows, columns, weights.astype(columns.dtype))

    def apply(self, vector: Float[np.ndarray, " unknown"]) -> None:
        """Replace a vector by (I + W K Wᵀ)⁻¹ times it."""
        part = vector[self.rows]
        vector[self.rows] = part - self.columns @ (self.weights @ (self.columns.T @ part))
