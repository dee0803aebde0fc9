"""The network: the nodes of every spring and hinge. Connectivity only, no parameters.

Nodes lie on a grid, numbered course by course from the bottom left. The network depends only on the
mesh shape, so that designs of one shape share a compiled program.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, wraps
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.model.pattern import PatchGrid
from knitlab.model.settings import Boundary

LARGE = 2048  # number of nodes above which a mesh shape is large; no subdomain is
LARGE_KEPT = 2  # results that are kept: a large sample needs two, relaxed and under tension
SMALL_KEPT = 32

Frame = tuple[tuple[float, float], tuple[float, float]]
Spans = tuple[tuple[int, int], ...]
"""Of every row of grid cells the first column with fabric, and the one after the last."""
UPRIGHT: Frame = ((1.0, 0.0), (0.0, 1.0))
"""The frame of which the lengths are L_x, L_y and the shift along x of the upper end [mm]."""
LENGTHS = ((0, 0, 0), (1, 1, 1), (2, 0, 1))
"""Of every length: its number, the coordinate of an image that it moves, and its factor, as an
index of :attr:`Elements.periods`."""
Others = ParamSpec("Others")
Result = TypeVar("Result")


@dataclass(frozen=True)
class MeshShape:
    """Grid cells along y (courses) and along x (wales), and whether the sheet is periodic.

    Periodic fabric whose lattice may shear has a ``frame``: the vectors (x, y), as the columns of a
    matrix, of one period along the courses and one along the wales at lengths 1, 1 and shear 0.
    A shaped piece has ``spans``: nodes and cells outside them have numbers, but no fabric.
    """

    cells_y: int
    cells_x: int
    periodic: bool
    frame: Frame | None = None
    spans: Spans | None = None

    @cached_property
    def has_fabric(self) -> Bool[np.ndarray, "cell_y cell_x"]:
        """Which grid cells have fabric."""
        if self.spans is None:
            return np.ones((self.cells_y, self.cells_x), bool)
        first, last = np.array(self.spans).T[..., None]
        column = np.arange(self.cells_x)
        return np.asarray((first <= column) & (column < last))

    @cached_property
    def nodes_of_fabric(self) -> Bool[np.ndarray, "node_y node_x"]:
        """Which nodes are corners of a grid cell with fabric."""
        if self.spans is None:
            return np.ones((self.nodes_y, self.nodes_x), bool)
        beside = np.pad(self.has_fabric, 1)
        return beside[1:, 1:] | beside[1:, :-1] | beside[:-1, 1:] | beside[:-1, :-1]

    @property
    def nodes_y(self) -> int:
        """Rows of nodes: one more than of cells, unless the sheet is periodic."""
        return self.cells_y + (not self.periodic)

    @property
    def nodes_x(self) -> int:
        """Columns of nodes."""
        return self.cells_x + (not self.periodic)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.nodes_y * self.nodes_x

    @property
    def unknowns(self) -> int:
        """Number of unknowns: three coordinates per node, then the lengths."""
        return 3 * self.nodes + self.lengths

    @property
    def lengths(self) -> int:
        """Number of lengths: L_x and L_y and, of a lattice that may shear, its shear."""
        return 2 if self.frame is None else 3


def mesh_shape(pattern: PatchGrid, boundary: Boundary, spans: Spans | None = None) -> MeshShape:
    """Mesh shape of a pattern with a boundary, or of the part of it within ``spans``."""
    return MeshShape(*pattern.grid, boundary == "periodic", spans=spans)


def cached_by_shape(
    function: Callable[Concatenate[MeshShape, Others], Result],
) -> Callable[Concatenate[MeshShape, Others], Result]:
    """Decorator that caches the most recent results for small and for large mesh shapes.

    What follows from a large shape may take a gigabyte; many small ones would evict it.
    """
    large: Callable[..., Result] = lru_cache(LARGE_KEPT)(function)
    small: Callable[..., Result] = lru_cache(SMALL_KEPT)(function)

    @wraps(function)
    def cached(shape: MeshShape, *args: Others.args, **kwargs: Others.kwargs) -> Result:
        return (large if shape.nodes > LARGE else small)(shape, *args, **kwargs)

    return cached


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of one kind, whose energy depends on a few vectors between their nodes."""

    nodes: Int[np.ndarray, "element node"]
    # lengths (x, y) by which each node is shifted: numbers of periods, or of those of the frame
    images: Float[np.ndarray, "element node 2"]
    incidence: Int[np.ndarray, "vector node"]  # −1 where a vector starts, 1 where it ends
    shape: MeshShape

    @cached_property
    def ends(self) -> list[tuple[int, int]]:
        """Indices of the nodes where each vector starts and ends."""
        return [(int(np.argmin(row)), int(np.argmax(row))) for row in self.incidence]

    @cached_property
    def periods(self) -> Float[np.ndarray, "vector 2 element"]:
        """Lengths of periodic fabric along (x, y) that each vector spans."""
        return np.einsum("vn,enk->vke", self.incidence, self.images)


HINGE_VECTORS = np.array(
    [
        [-1, 1, 0, 0, 0, 0],
        [0, 1, -1, 0, 0, 0],
        [-1, 0, 0, 1, 0, 0],
        [-1, 0, 0, 0, 0, 1],
        [0, 1, 0, 0, -1, 0],
    ]
)
"""The shared edge from a to b, the diagonals c → b and a → d of the cell before it, and a → f
and e → b of the cell after it."""


@dataclass(frozen=True, eq=False)
class Network:
    """Springs and hinges of one mesh shape (paper, Sec. "3D model", Fig. 1F)."""

    shape: MeshShape
    springs: Elements  # along the weft, along the warp, then two diagonals per cell
    weft: Bool[np.ndarray, " spring"]
    warp: Bool[np.ndarray, " spring"]
    hinges: Elements  # a, b of the shared edge; c, d before it and e, f after it, c and e at a
    wale: Bool[np.ndarray, " hinge"]  # those about edges along y, as rib ridges are
    spring_cells: Int[np.ndarray, "spring 2 2"]  # (y, x) on both sides, or one cell twice
    hinge_cells: Int[np.ndarray, "hinge 2"]  # (y, x) after the edge

    @property
    def beside_hinges(self) -> list[tuple[np.ndarray, ...]]:
        """Rows and columns of the grid cells before and after the edge of every hinge."""
        after = self.hinge_cells
        before = after - np.where(self.wale[:, None], [0, 1], [1, 0])
        size = [self.shape.cells_y, self.shape.cells_x]
        return [tuple((cells % size).T) for cells in (before, after)]


@cached_by_shape
def network(shape: MeshShape) -> Network:
    """Build the network of a mesh shape."""
    if shape.spans is not None:
        return _with_fabric(network(replace(shape, spans=None)), shape)
    cells = cells_y, cells_x = np.arange(shape.cells_y), np.arange(shape.cells_x)
    rows = np.arange(shape.nodes_y)
    columns = np.arange(shape.nodes_x)
    first = 0 if shape.periodic else 1
    # Rows and columns with such an element, its nodes, and the cells beside it.
    springs = (
        ((rows, cells_x), [(0, 0), (0, 1)], [(-1, 0), (0, 0)]),
        ((cells_y, columns), [(0, 0), (1, 0)], [(0, -1), (0, 0)]),
        (cells, [(0, 0), (1, 1)], [(0, 0), (0, 0)]),
        (cells, [(0, 1), (1, 0)], [(0, 0), (0, 0)]),
    )
    hinges = (
        ((cells_y, cells_x[first:]), [(0, 0), (1, 0), (0, -1), (1, -1), (0, 1), (1, 1)]),
        # The edge points to −x so that, as for a wale hinge, a mountain has a positive angle.
        ((cells_y[first:], cells_x), [(0, 1), (0, 0), (-1, 1), (-1, 0), (1, 1), (1, 0)]),
    )

    def elements(incidence: np.ndarray, indices: list[np.ndarray]) -> Elements:
        turns, wrapped = np.divmod(np.concatenate(indices), (shape.nodes_y, shape.nodes_x))
        nodes = wrapped[..., 0] * shape.nodes_x + wrapped[..., 1]
        images = turns[..., ::-1] @ np.transpose(shape.frame or UPRIGHT)
        return Elements(nodes, images, incidence, shape)

    spring_nodes = [_at_every(origins, nodes) for origins, nodes, _ in springs]
    hinge_nodes = [_at_every(origins, nodes) for origins, nodes in hinges]
    kind = np.repeat(np.arange(len(springs)), [len(nodes) for nodes in spring_nodes])
    beside = np.concatenate([_at_every(origins, beside_it) for origins, _, beside_it in springs])
    size = np.array([shape.cells_y, shape.cells_x])
    return Network(
        shape=shape,
        springs=elements(np.array([[-1, 1]]), spring_nodes),
        weft=kind == 0,
        warp=kind == 1,
        hinges=elements(HINGE_VECTORS, hinge_nodes),
        wale=np.repeat([True, False], [len(nodes) for nodes in hinge_nodes]),
        # At an edge there is a cell only on one side.
        spring_cells=beside % size if shape.periodic else np.clip(beside, 0, size - 1),
        hinge_cells=np.concatenate([_at_every(origins, [(0, 0)])[:, 0] for origins, _ in hinges]),
    )


def _with_fabric(whole: Network, shape: MeshShape) -> Network:
    """The springs of a network that belong to a cell with fabric, and the hinges between two."""
    has_fabric = shape.has_fabric
    sides = has_fabric[tuple(whole.spring_cells.transpose(2, 0, 1))]
    one, other = whole.spring_cells.transpose(1, 0, 2)
    # At an edge the cell with fabric counts twice.
    cells = np.stack(
        [
            np.where(sides[:, [side]], own, beside)
            for side, own, beside in ((0, one, other), (1, other, one))
        ],
        axis=1,
    )
    springs = np.flatnonzero(sides.any(axis=1))
    before, after = whole.beside_hinges
    hinges = np.flatnonzero(has_fabric[before] & has_fabric[after])

    def part(elements: Elements, kept: Int[np.ndarray, " kept"]) -> Elements:
        return Elements(elements.nodes[kept], elements.images[kept], elements.incidence, shape)

    return Network(
        shape=shape,
        springs=part(whole.springs, springs),
        weft=whole.weft[springs],
        warp=whole.warp[springs],
        hinges=part(whole.hinges, hinges),
        wale=whole.wale[hinges],
        spring_cells=cells[springs],
        hinge_cells=whole.hinge_cells[hinges],
    )


def _at_every(
    origins: tuple[np.ndarray, np.ndarray], offsets: list[tuple[int, int]]
) -> Int[np.ndarray, "element node 2"]:
    """Rows and columns of the nodes of the element at every row and column."""
    grid = np.stack(np.meshgrid(*origins, indexing="ij"), axis=-1)
    return grid.reshape(-1, 1, 2) + np.array(offsets)
