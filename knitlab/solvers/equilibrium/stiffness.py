"""Stiffness of the free unknowns: its sparsity, its elimination order, and its non-zeros.

The non-zeros are a constant sparse matrix times the entries of the element Hessians. Unknowns come
in groups: the coordinates of a node, or the lengths. As all unknowns of coupled groups are coupled,
the place of a non-zero follows from that of its pair of groups.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.model.energy import HINGE_ENTRIES, LANES, SPRING_ENTRIES, ElementHessians
from knitlab.model.network import LENGTHS, Elements, MeshShape, cached_by_shape, network
from knitlab.model.threads import ALONE, Threads
from knitlab.solvers.factorisation.symbolic_factorisation import (
    GridOrder,
    NestedDissection,
    grid_order,
    planned,
)

Freedom = tuple[int, int, Float[np.ndarray, " element"]]
"""An unknown of a group, the coordinate of a node that it moves, and the derivative."""


@dataclass(frozen=True, eq=False)
class MeshStiffness:
    """Sparsity of the stiffness of all unknowns: compressed columns of the lower triangle.

    ``halves`` are, for both halves of the non-zeros, constant matrices from the entries of the
    Hessians of springs, hinges and walls.
    """

    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    halves: list[list[sp.csr_array]]


@dataclass(frozen=True, eq=False)
class FreeStiffness:
    """Sparsity of the stiffness of the free unknowns."""

    shape: MeshShape
    dofs: Int[np.ndarray, " free"]  # degrees of freedom: indices of the free unknowns, ascending
    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    mesh: MeshStiffness
    selected: Int[np.ndarray, " nonzero"]  # non-zeros of the mesh between free unknowns

    @cached_property
    def heights(self) -> Int[np.ndarray, " height"]:
        """Indices, among the free unknowns, of those that are heights of nodes."""
        return np.flatnonzero((self.dofs % 3 == 2) & (self.dofs < 3 * self.shape.nodes))

    @cached_property
    def order(self) -> GridOrder:
        """Elimination order by nested dissection of the grid."""
        nodes = np.divmod(self.dofs // 3, self.shape.nodes_x)
        of_lengths = self.dofs >= 3 * self.shape.nodes
        return grid_order(
            self.indptr, self.indices, *(np.where(of_lengths, -1, line) for line in nodes)
        )

    @cached_property
    def plan(self) -> NestedDissection:
        """Symbolic factorisation."""
        return planned(self.order, self.indptr, self.indices)

    def entries(
        self, hessians: ElementHessians, threads: Threads = ALONE
    ) -> Float[np.ndarray, " nonzero"]:
        """Non-zeros of the stiffness, from the element Hessians of one configuration [N/mm]."""
        sources = [np.ravel(each) for each in (hessians.springs, hessians.hinges, hessians.walls)]

        def summed(matrices: list[sp.csr_array]) -> Float[np.ndarray, " half"]:
            first, *others = (matrix @ each for matrix, each in zip(matrices, sources, strict=True))
            for other in others:
                first += other
            return first

        return np.concatenate(threads.each(summed, self.mesh.halves))[self.selected]

    def shifted(
        self, entries: Float[np.ndarray, " nonzero"], shift: float
    ) -> Float[np.ndarray, " nonzero"]:
        """Non-zeros with ``shift`` times the identity added [N/mm]."""
        moved = entries.copy()
        moved[self.indptr[:-1]] += shift
        return moved

    def lower(self, entries: Float[np.ndarray, " nonzero"]) -> sp.csc_array:
        """The lower triangle with these non-zeros."""
        size = len(self.dofs)
        return sp.csc_array((entries, self.indices, self.indptr), shape=(size, size))


def free_stiffness(shape: MeshShape, free: Int[np.ndarray, " free"]) -> FreeStiffness:
    """Sparsity for the free unknowns of a mesh shape, ascending; recent ones are kept."""
    return _free_stiffness(shape, free.astype(np.int64).tobytes())


@cached_by_shape
def _free_stiffness(shape: MeshShape, free_bytes: bytes) -> FreeStiffness:
    mesh = _mesh_stiffness(shape)
    free = np.frombuffer(free_bytes, dtype=np.int64)
    number = np.full(shape.unknowns, -1, dtype=np.int32)
    number[free] = np.arange(len(free))
    rows = number[mesh.indices]
    columns = np.repeat(number, np.diff(mesh.indptr))
    selected = np.flatnonzero((rows >= 0) & (columns >= 0)).astype(np.int32)
    lengths = np.bincount(columns[selected], minlength=len(free))
    indptr = np.append(0, np.cumsum(lengths)).astype(np.int32)
    return FreeStiffness(shape, free, indptr, rows[selected], mesh, selected)


@cached_by_shape
def _mesh_stiffness(shape: MeshShape) -> MeshStiffness:
    net = network(shape)
    springs = len(net.springs.nodes)
    hinges = len(net.hinges.nodes)
    pairs = _coupled_groups(shape, net.springs, net.hinges)
    whole = sp.tril(sp.kron(pairs, np.ones((3, 3)), "coo"), format="csc")
    # The lengths may be two unknowns, not three.
    lower = whole[: shape.unknowns, : shape.unknowns]
    lower.sort_indices()
    indptr = lower.indptr
    nodes = np.arange(shape.nodes, dtype=np.int32)

    spring_at = _indices_in_triangle(SPRING_ENTRIES)
    hinge_at = _indices_in_triangle(HINGE_ENTRIES)
    block, lane = np.divmod(np.arange(hinges), LANES)
    of_hinge = len(HINGE_ENTRIES[0])

    def spring_entry(i: int, j: int) -> tuple[Int[np.ndarray, " element"], int]:
        sign = 1 if i // 3 == j // 3 else -1
        return spring_at[i % 3, j % 3] * springs + np.arange(springs), sign

    def hinge_entry(i: int, j: int) -> tuple[Int[np.ndarray, " element"], int]:
        return (block * of_hinge + hinge_at[i, j]) * LANES + lane, 1

    matrices = []
    for elements, entry, sources in (
        (net.springs, spring_entry, len(SPRING_ENTRIES[0]) * springs),
        (net.hinges, hinge_entry, of_hinge * LANES * -(-hinges // LANES)),
    ):
        terms = zip(*_terms(elements, entry, pairs, indptr), strict=True)
        rows, columns, values = (np.concatenate(each) for each in terms)
        matrices.append(sp.csr_array((values, (rows, columns)), shape=(lower.nnz, sources)))
    diagonal = indptr[3 * nodes + 2], nodes
    matrices.append(sp.csr_array((np.ones(shape.nodes), diagonal), shape=(lower.nnz, shape.nodes)))
    ends = [0, lower.nnz // 2, lower.nnz]
    halves = [[matrix[first:end] for matrix in matrices] for first, end in pairwise(ends)]
    return MeshStiffness(indptr, lower.indices, halves)


def _coupled_groups(shape: MeshShape, *kinds: Elements) -> sp.csc_array:
    """Pairs of groups that elements couple, the row not before the column."""
    groups = shape.nodes + 1
    coupled = sp.csr_array(sp.eye_array(groups))
    for elements in kinds:
        columns = np.stack([of_node for _, of_node, _ in _freedoms(elements)], axis=1)
        count, width = columns.shape
        incidence = sp.csr_array(
            (np.ones(columns.size), columns.ravel(), np.arange(count + 1) * width),
            shape=(count, groups),
        )
        coupled = coupled + incidence.T @ incidence
    pairs = sp.tril(coupled, format="csc")
    pairs.sort_indices()
    return pairs


def _freedoms(
    elements: Elements,
) -> Iterator[tuple[int, Int[np.ndarray, " element"], list[Freedom]]]:
    """Nodes of an element, the groups that each depends on, and by which of their unknowns."""
    for node, own in enumerate(elements.nodes.T):
        yield node, own, [(component, component, np.ones(len(own))) for component in range(3)]
        images = elements.images[:, node]
        shape = elements.shape
        if images.any():
            by_lengths = [
                (number, component, images[:, along])
                for number, component, along in LENGTHS[: shape.lengths]
            ]
            yield node, np.full(len(own), shape.nodes), by_lengths


def _terms(
    elements: Elements,
    entry: Callable[[int, int], tuple[Int[np.ndarray, " element"], int]],
    pairs: sp.csc_array,
    indptr: Int[np.ndarray, " column"],
) -> Iterator[
    tuple[Int[np.ndarray, " term"], Int[np.ndarray, " term"], Float[np.ndarray, " term"]]
]:
    """Non-zeros, entries of element Hessians that are added to them, and their factors."""
    groups = pairs.shape[0]
    first = np.repeat(np.arange(groups), np.diff(pairs.indptr))
    keys = first * groups + pairs.indices
    # Of every pair, the number of unknowns in earlier pairs of the same column.
    offsets = 3 * (np.arange(len(keys)) - pairs.indptr[first])
    for (i, rows, by_row), (j, columns, by_column) in product(_freedoms(elements), repeat=2):
        kept = np.flatnonzero(columns <= rows)
        row = rows[kept]
        column = columns[kept]
        offset = offsets[np.searchsorted(keys, column * groups + row)]
        for (x, along_x, by_x), (y, along_y, by_y) in product(by_row, by_column):
            source, sign = entry(3 * i + along_x, 3 * j + along_y)
            factor = sign * by_x[kept] * by_y[kept]
            index = indptr[3 * column + y] - y + offset + x
            used = (factor != 0) & ((column != row) | (x >= y))
            yield (index[used].astype(np.int32), source[kept][used].astype(np.int32), factor[used])


def _indices_in_triangle(entries: tuple[np.ndarray, np.ndarray]) -> Int[np.ndarray, "row column"]:
    """Index of every entry of a symmetric matrix among those of its lower triangle."""
    rows, columns = entries
    positions = np.zeros((rows.max() + 1,) * 2, dtype=np.int64)
    positions[rows, columns] = positions[columns, rows] = np.arange(len(rows))
    return positions
