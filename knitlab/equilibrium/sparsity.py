"""Sparsity of the stiffness of all unknowns of a mesh shape, and how element Hessians fill it.

The position of a node of an element depends on its three coordinates and, if the element crosses
the periodic boundary, on L_x and L_y. So the non-zeros of the stiffness are a constant sparse
matrix times the entries of the element Hessians. Unknowns come in groups: the coordinates of a
node, or L_x and L_y. As all unknowns of coupled groups are coupled, the place of a non-zero follows
from that of its pair of groups; a search for every non-zero would take minutes for a large sample.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.fabric.element_hessians import HINGE_ENTRIES, LANES, SPRING_ENTRIES, ElementHessians
from knitlab.fabric.network import Elements, MeshShape, cached_by_shape, network
from knitlab.fabric.threads import ALONE, Threads


@dataclass(frozen=True, eq=False)
class MeshStiffness:
    """Sparsity of the stiffness of all unknowns.

    Attributes:
        indptr, indices: compressed-column sparsity of the lower triangle; the diagonal entry is
            the first of its column.
        from_springs, from_hinges, from_walls: constant matrices from entries of element Hessians
            to non-zeros.
    """

    indptr: Int[np.ndarray, " column"]
    indices: Int[np.ndarray, " nonzero"]
    from_springs: sp.csr_array
    from_hinges: sp.csr_array
    from_walls: sp.csr_array

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


def _rows(matrix: sp.csr_array, first: int, end: int) -> sp.csr_array:
    """Some rows of a matrix, which share its memory."""
    places = slice(matrix.indptr[first], matrix.indptr[end])
    row_ends = matrix.indptr[first : end + 1] - matrix.indptr[first]
    return sp.csr_array(
        (matrix.data[places], matrix.indices[places], row_ends),
        shape=(end - first, matrix.shape[1]),
    )


@cached_by_shape
def mesh_stiffness(shape: MeshShape) -> MeshStiffness:
    """Sparsity of the stiffness of all unknowns of a mesh shape's network."""
    net = network(shape)
    springs, hinges = len(net.springs.nodes), len(net.hinges.nodes)
    couplings = _couplings(net.springs, net.hinges)
    indptr = couplings.indptr
    nodes = np.arange(shape.nodes, dtype=np.int32)
    return MeshStiffness(
        indptr=indptr,
        indices=couplings.rows(),
        from_springs=couplings.matrix(
            net.springs, _spring_entry(springs), len(SPRING_ENTRIES[0]) * springs
        ),
        from_hinges=couplings.matrix(
            net.hinges, _hinge_entry(hinges), len(HINGE_ENTRIES[0]) * LANES * -(-hinges // LANES)
        ),
        from_walls=sp.csr_array(
            (np.ones(shape.nodes), (indptr[3 * nodes + 2], nodes)),
            shape=(indptr[-1], shape.nodes),
        ),
    )


@dataclass(frozen=True, eq=False)
class _Freedoms:
    """Unknowns of one group on which a node of every element depends.

    Attributes:
        groups: group of every element: its node, or the number of nodes for L_x and L_y.
        derivatives: of each of the node's coordinates by the unknown of the group with the same
            index; ``None`` where they are 1.
    """

    groups: Int[np.ndarray, " element"]
    derivatives: tuple[Float[np.ndarray, " element"] | None, ...]


def _freedoms(elements: Elements, node: int) -> Iterator[_Freedoms]:
    yield _Freedoms(elements.nodes[:, node], (None, None, None))
    images = elements.images[:, node]
    if images.any():
        lengths = np.full(len(images), elements.shape.nodes)
        yield _Freedoms(lengths, tuple(images.T.astype(float)))


Entry = Callable[[int, int], tuple[Int[np.ndarray, " element"], int]]
"""Index and sign of an entry of the Hessian of every element by its nodes."""


@dataclass(frozen=True, eq=False)
class _Couplings:
    """Coupled pairs of groups, the second not before the first.

    Attributes:
        groups: number of groups.
        keys: first × ``groups`` + second of every pair, ascending.
        offsets: for every pair, number of unknowns in earlier pairs with the same first group.
        indptr: start of every column of the lower triangle.
    """

    groups: int
    keys: Int[np.ndarray, " pair"]
    offsets: Int[np.ndarray, " pair"]
    indptr: Int[np.ndarray, " column"]

    def rows(self) -> Int[np.ndarray, " nonzero"]:
        """Row of every non-zero, column by column."""
        first, second = np.divmod(self.keys, self.groups)
        # A column has the unknowns of the pairs of its group, from the diagonal on.
        listed = (3 * second[:, None] + np.arange(3)).ravel()
        existing = listed < len(self.indptr) - 1
        listed, owners = listed[existing], np.repeat(first, 3)[existing]
        starts = np.searchsorted(owners, np.arange(self.groups))
        columns = np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))
        group, within = np.divmod(columns, 3)
        places = np.arange(len(columns)) - self.indptr[columns] + starts[group] + within
        return listed[places].astype(np.int32)

    def matrix(self, elements: Elements, entry: Entry, sources: int) -> sp.csr_array:
        """The constant matrix from entries of the element Hessians to non-zeros."""
        terms = [np.concatenate(part) for part in zip(*self._terms(elements, entry), strict=True)]
        rows, columns, values = terms
        return sp.csr_array((values, (rows, columns)), shape=(self.indptr[-1], sources))

    def _terms(
        self, elements: Elements, entry: Entry
    ) -> Iterator[
        tuple[
            Int[np.ndarray, " term"],
            Int[np.ndarray, " term"],
            Float[np.ndarray, " term"],
        ]
    ]:
        """Non-zeros, entries of element Hessians that are added to them, and their factors."""
        nodes = range(elements.nodes.shape[1])
        freedoms = [(node, each) for node in nodes for each in _freedoms(elements, node)]
        for (i, row), (j, column) in product(freedoms, repeat=2):
            kept = np.flatnonzero(column.groups <= row.groups)
            group = column.groups[kept]
            same = group == row.groups[kept]
            pair = np.searchsorted(self.keys, group * self.groups + row.groups[kept])
            offset = self.offsets[pair]
            for x, by_row in enumerate(row.derivatives):
                for y, by_column in enumerate(column.derivatives):
                    source, sign = entry(3 * i + x, 3 * j + y)
                    factor = np.full(len(kept), float(sign))
                    for derivative in (by_row, by_column):
                        if derivative is not None:
                            factor *= derivative[kept]
                    place = self.indptr[3 * group + y] - y + offset + x
                    used = (factor != 0) & (~same | (x >= y))
                    yield (
                        place[used].astype(np.int32),
                        source[kept][used].astype(np.int32),
                        factor[used],
                    )


def _couplings(*kinds: Elements) -> _Couplings:
    """The pairs that elements couple, and each group with itself."""
    nodes = kinds[0].shape.nodes
    groups = nodes + 1
    keys = [np.arange(groups) * (groups + 1)]
    for elements in kinds:
        freedoms = [
            each for node in range(elements.nodes.shape[1]) for each in _freedoms(elements, node)
        ]
        for one, other in product(freedoms, repeat=2):
            pairs = one.groups * groups + other.groups
            keys.append(pairs[one.groups < other.groups])
    # NumPy's unique hashes integers, which takes several times as long as sorting them.
    found = np.sort(np.concatenate(keys))
    found = found[np.append(True, np.diff(found) > 0)]
    first, second = np.divmod(found, groups)
    sizes = np.append(np.full(nodes, 3), 2)
    ends = np.cumsum(sizes[second])
    starts = ends - sizes[second]
    own = starts[np.searchsorted(first, np.arange(groups))]
    within = np.arange(3 * nodes + 2) % 3
    lengths = np.repeat(np.diff(own, append=ends[-1]), sizes) - within
    indptr = np.append(0, np.cumsum(lengths)).astype(np.int32)
    return _Couplings(groups, found, (starts - own[first]).astype(np.int32), indptr)


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
