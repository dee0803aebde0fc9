"""Stiffness of the free unknowns, summed from element Hessians on a fixed sparsity.

The position of a node of an element depends on its three coordinates and, if the element crosses
the periodic boundary, on L_x and L_y. So the non-zeros of the stiffness are a constant sparse
matrix times the entries of the element Hessians. The matrix is built once for a mesh shape and a
choice of free unknowns; after that an assembly is one sparse product.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.elasticity.element_stiffness import HINGE_ENTRIES, LANES, SPRING_ENTRIES
from knitlab.elasticity.evaluation import ElementHessians
from knitlab.linalg.threads import ALONE, Threads
from knitlab.model.network import Elements, MeshShape, network


@dataclass(frozen=True, eq=False)
class FreeStiffness:
    """Sparsity of the stiffness of the free unknowns, and how element Hessians fill it.

    Attributes:
        shape: the mesh shape.
        places: indices of the free unknowns, ascending.
        indptr, indices: compressed-column sparsity of the lower triangle; the diagonal entry is
            the first of its column.
        from_springs, from_hinges, from_walls: constant matrices from entries of element Hessians
            to non-zeros.
    """

    shape: MeshShape
    places: Int[np.ndarray, " free"]
    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    from_springs: sp.csr_array
    from_hinges: sp.csr_array
    from_walls: sp.csr_array

    @property
    def diagonal(self) -> Int[np.ndarray, " free"]:
        """Indices of the non-zeros on the diagonal."""
        return self.indptr[:-1]

    @cached_property
    def grid(self) -> tuple[Int[np.ndarray, " free"], Int[np.ndarray, " free"]]:
        """Row and column of the node that every free unknown belongs to; −1 for L_x and L_y."""
        rows, columns = np.divmod(self.places // 3, self.shape.nodes_x)
        length = self.places >= 3 * self.shape.nodes
        return np.where(length, -1, rows), np.where(length, -1, columns)

    @cached_property
    def _halves(self) -> list[list[sp.csr_array]]:
        """The matrices for the first and for the second half of the non-zeros."""
        matrices = self.from_springs, self.from_hinges, self.from_walls
        ends = [0, len(self.indices) // 2, len(self.indices)]
        return [[_rows(matrix, *ends) for matrix in matrices] for ends in pairwise(ends)]

    def entries(
        self, hessians: ElementHessians, threads: Threads = ALONE
    ) -> Float[np.ndarray, " nonzero"]:
        """Non-zeros of the stiffness, from the element Hessians of one configuration [N/mm]."""
        sources = [np.ravel(part) for part in (hessians.springs, hessians.hinges, hessians.walls)]

        def summed(matrices: list[sp.csr_array]) -> Float[np.ndarray, " half"]:
            first, *others = (a @ part for a, part in zip(matrices, sources, strict=True))
            for other in others:
                first += other
            return first

        return np.concatenate(threads.each(summed, self._halves))

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


def _rows(matrix: sp.csr_array, first: int, end: int) -> sp.csr_array:
    """Some rows of a matrix, which share its memory."""
    places = slice(matrix.indptr[first], matrix.indptr[end])
    row_ends = matrix.indptr[first : end + 1] - matrix.indptr[first]
    return sp.csr_array(
        (matrix.data[places], matrix.indices[places], row_ends),
        shape=(end - first, matrix.shape[1]),
    )


def free_stiffness(shape: MeshShape, free: Int[np.ndarray, " free"]) -> FreeStiffness:
    """Like :func:`sparsity`, with the most recent results cached."""
    return _free_stiffness(shape, free.astype(np.int64).tobytes())


@lru_cache(maxsize=8)
def _free_stiffness(shape: MeshShape, free_bytes: bytes) -> FreeStiffness:
    return sparsity(shape, np.frombuffer(free_bytes, dtype=np.int64))


def sparsity(shape: MeshShape, free: Int[np.ndarray, " free"]) -> FreeStiffness:
    """Sparsity of the stiffness of a mesh shape's network, restricted to free unknowns.

    Args:
        shape: the mesh shape.
        free: indices of the free unknowns, ascending.
    """
    net = network(shape)
    size = len(free)
    number = np.full(shape.unknowns, -1)
    number[free] = np.arange(size)
    heights = number[3 * np.arange(shape.nodes) + 2]
    raised = np.flatnonzero(heights >= 0)

    springs = _terms(net.springs, number, size, _spring_entry(len(net.springs.nodes)))
    hinges = _terms(net.hinges, number, size, _hinge_entry(len(net.hinges.nodes)))
    walls = _Terms(heights[raised] * (size + 1), raised, np.ones(len(raised)))
    # NumPy's unique hashes integers, which takes several times as long as sorting them.
    keys = np.sort(np.concatenate([springs.key, hinges.key, np.arange(size) * (size + 1)]))
    keys = keys[np.append(True, np.diff(keys) > 0)]
    columns, rows = np.divmod(keys, size)
    blocks = -(-len(net.hinges.nodes) // LANES)
    return FreeStiffness(
        shape=shape,
        places=free,
        indptr=np.searchsorted(columns, np.arange(size + 1)).astype(np.int32),
        indices=rows.astype(np.int32),
        from_springs=springs.into(keys, len(SPRING_ENTRIES[0]) * len(net.springs.nodes)),
        from_hinges=hinges.into(keys, len(HINGE_ENTRIES[0]) * LANES * blocks),
        from_walls=walls.into(keys, shape.nodes),
    )


@dataclass(frozen=True, eq=False)
class _Terms:
    """Terms of the stiffness: ``factor`` × element Hessian entry ``source``, at ``key``."""

    key: Int[np.ndarray, " term"]
    source: Int[np.ndarray, " term"]
    factor: Float[np.ndarray, " term"]

    def into(self, keys: Int[np.ndarray, " nonzero"], sources: int) -> sp.csr_array:
        """The constant matrix from element Hessian entries to the non-zeros at ``keys``."""
        rows = np.searchsorted(keys, self.key)
        return sp.csr_array((self.factor, (rows, self.source)), shape=(len(keys), sources))


Entry = Callable[[int, int], tuple[Int[np.ndarray, " element"], int]]
"""Index and sign of an entry of the Hessian of every element by its nodes."""


def _spring_entry(count: int) -> Entry:
    position = _position(SPRING_ENTRIES)

    def entry(i: int, j: int) -> tuple[Int[np.ndarray, " element"], int]:
        sign = 1 if i // 3 == j // 3 else -1
        return position[i % 3, j % 3] * count + np.arange(count), sign

    return entry


def _hinge_entry(count: int) -> Entry:
    position = _position(HINGE_ENTRIES)
    block, lane = np.divmod(np.arange(count), LANES)

    def entry(i: int, j: int) -> tuple[Int[np.ndarray, " element"], int]:
        return (block * len(HINGE_ENTRIES[0]) + position[i, j]) * LANES + lane, 1

    return entry


def _position(entries: tuple[np.ndarray, np.ndarray]) -> Int[np.ndarray, "row column"]:
    """Index of every entry of a symmetric matrix among those of its lower triangle."""
    rows, columns = entries
    position = np.zeros((rows.max() + 1,) * 2, dtype=np.int64)
    position[rows, columns] = position[columns, rows] = np.arange(len(rows))
    return position


def _terms(
    elements: Elements, number: Int[np.ndarray, " unknown"], size: int, entry: Entry
) -> _Terms:
    """Terms of all pairs of coordinates of an element's nodes that are in the lower triangle."""
    freedoms = [
        _freedoms(elements, number, node, component)
        for node in range(elements.nodes.shape[1])
        for component in range(3)
    ]
    parts: list[_Terms] = []
    for i, moving in enumerate(freedoms):
        for j, moved in enumerate(freedoms):
            source, sign = entry(i, j)
            for row, by_row in moving:
                for column, by_column in moved:
                    factor = sign * by_row * by_column
                    kept = (row >= column) & (column >= 0) & (factor != 0)
                    key = column[kept] * size + row[kept]
                    parts.append(_Terms(key, source[kept], factor[kept]))
    return _Terms(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("key", "source", "factor"))
    )


def _freedoms(
    elements: Elements, number: Int[np.ndarray, " unknown"], node: int, component: int
) -> list[tuple[Int[np.ndarray, " element"], Float[np.ndarray, " element"]]]:
    """Free unknowns on which a node of every element depends (−1 if fixed), and the derivatives."""
    coordinate = number[3 * elements.nodes[:, node] + component], np.ones(len(elements.nodes))
    if component == 2 or not elements.images[:, node, component].any():
        return [coordinate]
    length = np.full(len(elements.nodes), number[3 * elements.shape.nodes + component])
    return [coordinate, (length, elements.images[:, node, component].astype(float))]
