"""Stiffness of the free unknowns: the non-zeros of the whole stiffness between them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.equilibrium.sparsity import MeshStiffness, mesh_stiffness
from knitlab.fabric.element_hessians import ElementHessians
from knitlab.fabric.network import MeshShape, cached_by_shape
from knitlab.fabric.threads import ALONE, Threads


@dataclass(frozen=True, eq=False)
class FreeStiffness:
    """Sparsity of the stiffness of the free unknowns.

    Attributes:
        shape: the mesh shape.
        places: indices of the free unknowns, ascending.
        indptr, indices: compressed-column sparsity of the lower triangle; the diagonal entry is
            the first of its column.
        mesh: the stiffness of all unknowns.
        selected: indices of its non-zeros between free unknowns.
    """

    shape: MeshShape
    places: Int[np.ndarray, " free"]
    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    mesh: MeshStiffness
    selected: Int[np.ndarray, " nonzero"]

    @property
    def diagonal(self) -> Int[np.ndarray, " free"]:
        """Indices of the non-zeros on the diagonal."""
        return self.indptr[:-1]

    @cached_property
    def heights(self) -> Int[np.ndarray, " height"]:
        """Indices, among the free unknowns, of those that are heights of nodes."""
        return np.flatnonzero((self.places % 3 == 2) & (self.places < 3 * self.shape.nodes))

    @cached_property
    def grid(self) -> tuple[Int[np.ndarray, " free"], Int[np.ndarray, " free"]]:
        """Row and column of the node that every free unknown belongs to; −1 for L_x and L_y."""
        rows, columns = np.divmod(self.places // 3, self.shape.nodes_x)
        length = self.places >= 3 * self.shape.nodes
        return np.where(length, -1, rows), np.where(length, -1, columns)

    def entries(
        self, hessians: ElementHessians, threads: Threads = ALONE
    ) -> Float[np.ndarray, " nonzero"]:
        """Non-zeros of the stiffness, from the element Hessians of one configuration [N/mm]."""
        return self.mesh.entries(hessians, threads)[self.selected]

    def shifted(
        self, entries: Float[np.ndarray, " nonzero"], shift: float
    ) -> Float[np.ndarray, " nonzero"]:
        """Non-zeros with ``shift`` times the identity added [N/mm]."""
        moved = entries.copy()
        moved[self.diagonal] += shift
        return moved

    def lower(self, entries: Float[np.ndarray, " nonzero"]) -> sp.csc_array:
        """The lower triangle with these non-zeros."""
        size = len(self.places)
        return sp.csc_array((entries, self.indices, self.indptr), shape=(size, size))


def free_stiffness(shape: MeshShape, free: Int[np.ndarray, " free"]) -> FreeStiffness:
    """Sparsity of the stiffness of a mesh shape's network, restricted to free unknowns.

    The most recent results are kept.

    Args:
        shape: the mesh shape.
        free: indices of the free unknowns, ascending.
    """
    return _free_stiffness(shape, free.astype(np.int64).tobytes())


@cached_by_shape
def _free_stiffness(shape: MeshShape, free_bytes: bytes) -> FreeStiffness:
    mesh, free = mesh_stiffness(shape), np.frombuffer(free_bytes, dtype=np.int64)
    number = np.full(shape.unknowns, -1, dtype=np.int32)
    number[free] = np.arange(len(free))
    rows, columns = number[mesh.indices], np.repeat(number, np.diff(mesh.indptr))
    selected = np.flatnonzero((rows >= 0) & (columns >= 0)).astype(np.int32)
    lengths = np.bincount(columns[selected], minlength=len(free))
    return FreeStiffness(
        shape=shape,
        places=free,
        indptr=np.append(0, np.cumsum(lengths)).astype(np.int32),
        indices=rows[selected],
        mesh=mesh,
        selected=selected,
    )
