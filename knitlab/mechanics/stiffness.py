"""Stiffness of the free unknowns, summed from element Hessians on a fixed sparsity.

An element's vectors are linear in the unknowns, so the non-zeros of the stiffness are a constant
sparse matrix, of signs, times the element Hessians. It is built once for a mesh shape and a
choice of free unknowns; after that an assembly is one sparse product.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.mechanics.evaluation import Evaluation
from knitlab.model.network import Elements, MeshShape, network


@dataclass(frozen=True, eq=False)
class FreeStiffness:
    """Sparsity of the stiffness of the free unknowns, and how element Hessians fill it.

    Attributes:
        unknowns: places of the free unknowns, ascending.
        indptr, indices: compressed-column sparsity, both triangles.
        diagonal: which of the non-zeros lie on the diagonal.
        from_springs, from_hinges, from_walls: constant matrices from element Hessians to
            non-zeros.
    """

    unknowns: Int[np.ndarray, " free"]
    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    diagonal: Int[np.ndarray, " free"]
    from_springs: sp.csr_array
    from_hinges: sp.csr_array
    from_walls: sp.csr_array

    def matrix(self, evaluation: Evaluation) -> sp.csc_array:
        """Stiffness of the free unknowns [N/mm] of one evaluated configuration."""
        entries = (
            self.from_springs @ np.ravel(evaluation.springs)
            + self.from_hinges @ np.ravel(evaluation.hinges)
            + self.from_walls @ np.ravel(evaluation.walls)
        )
        return self._with(entries)

    def shifted(self, matrix: sp.csc_array, shift: float) -> sp.csc_array:
        """``matrix`` plus ``shift`` times the identity [N/mm]."""
        entries = matrix.data.copy()
        entries[self.diagonal] += shift
        return self._with(entries)

    def _with(self, entries: Float[np.ndarray, " nonzero"]) -> sp.csc_array:
        size = len(self.unknowns)
        return sp.csc_array((entries, self.indices, self.indptr), shape=(size, size))


@dataclass(frozen=True, eq=False)
class _Entries:
    """Terms of the stiffness: ``sign`` × element Hessian entry ``source``, at ``key``."""

    key: Int[np.ndarray, " term"]
    source: Int[np.ndarray, " term"]
    sign: Float[np.ndarray, " term"]
    sources: int

    def into(self, keys: Int[np.ndarray, " nonzero"]) -> sp.csr_array:
        """The constant matrix from element Hessians to the non-zeros at ``keys``."""
        rows = np.searchsorted(keys, self.key)
        return sp.csr_array((self.sign, (rows, self.source)), shape=(len(keys), self.sources))


def free_stiffness(shape: MeshShape, unknowns: Int[np.ndarray, " free"]) -> FreeStiffness:
    """Sparsity of the stiffness of a mesh shape's network, restricted to free unknowns."""
    return _free_stiffness(shape, unknowns.astype(np.int64).tobytes())


@lru_cache(maxsize=8)
def _free_stiffness(shape: MeshShape, unknown_bytes: bytes) -> FreeStiffness:
    net, unknowns = network(shape), np.frombuffer(unknown_bytes, dtype=np.int64)
    size = len(unknowns)
    number = np.full(shape.unknowns, -1)
    number[unknowns] = np.arange(size)

    springs, hinges = (_terms(elements, number, size) for elements in (net.springs, net.hinges))
    heights = number[3 * np.arange(shape.nodes) + 2]
    free = np.flatnonzero(heights >= 0)
    walls = _Entries(heights[free] * (size + 1), free, np.ones(len(free)), shape.nodes)

    diagonal_keys = np.arange(size) * (size + 1)
    keys = np.unique(np.concatenate([springs.key, hinges.key, diagonal_keys]))
    columns, rows = np.divmod(keys, size)
    return FreeStiffness(
        unknowns=unknowns,
        indptr=np.searchsorted(columns, np.arange(size + 1)).astype(np.int32),
        indices=rows.astype(np.int32),
        diagonal=np.searchsorted(keys, diagonal_keys),
        from_springs=springs.into(keys),
        from_hinges=hinges.into(keys),
        from_walls=walls.into(keys),
    )


def _terms(elements: Elements, number: Int[np.ndarray, " unknown"], size: int) -> _Entries:
    """Every product of two derivatives of an element's vector components by free unknowns."""
    unknowns, derivatives = _vector_derivatives(elements)
    places = number[unknowns]
    places = np.where(derivatives != 0, places, -1)
    components = places.shape[1]
    key = places[:, None, :, None, :] * size + places[:, :, None, :, None]
    sign = derivatives[:, None, :, None, :] * derivatives[:, :, None, :, None]
    free = places >= 0
    kept = free[:, None, :, None, :] & free[:, :, None, :, None]
    element, row, column, _, _ = np.nonzero(kept)
    source = (element * components + row) * components + column
    return _Entries(key[kept], source, sign[kept], len(places) * components**2)


def _vector_derivatives(elements: Elements) -> tuple[np.ndarray, np.ndarray]:
    """For every component of an element's vectors the three unknowns it hangs on, and how.

    They are the coordinates of its end and start, and the length L_x or L_y where it crosses
    the seam of endless fabric.
    """
    starts, ends = np.array(elements.ends).T
    count, vectors = len(elements.nodes), len(ends)
    unknowns = np.zeros((count, vectors, 3, 3), dtype=np.int64)
    derivatives = np.zeros((count, vectors, 3, 3))
    for component in range(3):
        unknowns[:, :, component, 0] = 3 * elements.nodes[:, ends] + component
        unknowns[:, :, component, 1] = 3 * elements.nodes[:, starts] + component
        derivatives[:, :, component, 0] = 1
        derivatives[:, :, component, 1] = -1
        if component < 2:
            unknowns[:, :, component, 2] = 3 * elements.shape.nodes + component
            derivatives[:, :, component, 2] = elements.periods[:, component].T
    return unknowns.reshape(count, -1, 3), derivatives.reshape(count, -1, 3)
