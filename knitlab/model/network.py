"""The network: which nodes a spring or a hinge joins. Topology only, no numbers.

Nodes lie on a rectangular grid, numbered course by course from the bottom left. The mesh shape
alone fixes the network, so designs that share a shape share one compiled program.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Int

from knitlab.model.pattern import Pattern
from knitlab.model.reading import Boundary


@dataclass(frozen=True)
class MeshShape:
    """Grid cells along y (courses) and along x (wales), and whether the sheet is endless."""

    cells_y: int
    cells_x: int
    periodic: bool

    @property
    def nodes_y(self) -> int:
        """Rows of nodes: one more than of cells, unless the sheet closes on itself."""
        return self.cells_y + (not self.periodic)

    @property
    def nodes_x(self) -> int:
        """Columns of nodes, likewise."""
        return self.cells_x + (not self.periodic)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.nodes_y * self.nodes_x

    @property
    def unknowns(self) -> int:
        """Length of a configuration: three coordinates a node, then the lengths L_x and L_y."""
        return 3 * self.nodes + 2


def mesh_shape(pattern: Pattern, boundary: Boundary) -> MeshShape:
    """Mesh shape of a pattern under a boundary."""
    return MeshShape(*pattern.rib_cells.shape, periodic=boundary == "periodic")


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of one kind, each over the same number of nodes.

    Attributes:
        nodes: node numbers of every element.
        images: periods of endless fabric along (x, y) by which each node is shifted; zero unless
            the element crosses the seam.
        shape: the mesh they belong to.
    """

    nodes: Int[np.ndarray, "element node"]
    images: Int[np.ndarray, "element node 2"]
    shape: MeshShape

    @cached_property
    def unknowns(self) -> Int[np.ndarray, "element unknown"]:
        """Places of an element's unknowns in the configuration: its coordinates, then L_x, L_y.

        −1 marks a length that the element does not feel.
        """
        coordinates = (3 * self.nodes[:, :, None] + np.arange(3)).reshape(len(self.nodes), -1)
        lengths = 3 * self.shape.nodes + np.arange(2)
        felt = np.where(self.images.any(axis=1), lengths, -1)
        return np.concatenate([coordinates, felt], axis=1)


@dataclass(frozen=True, eq=False)
class Network:
    """Springs and hinges of one mesh shape (paper, Sec. "3D model", Fig. 1F).

    Attributes:
        shape: the mesh shape.
        springs: two nodes each: weft springs, warp springs, then two diagonals a grid cell.
        weft, warp: which springs run along x, which along y; the others are diagonals.
        hinges: six nodes each: the ends a, b of the shared edge, the far nodes c, d of the cell
            before it and e, f of the cell after it (c and e beside a, d and f beside b).
        wale: which hinges turn about an edge along y, as rib ridges do; the others turn about
            an edge along x, as garter ridges do.
        hinge_cells: grid cell (y, x) after each hinge's edge.
    """

    shape: MeshShape
    springs: Elements
    weft: Bool[np.ndarray, " spring"]
    warp: Bool[np.ndarray, " spring"]
    hinges: Elements
    wale: Bool[np.ndarray, " hinge"]
    hinge_cells: Int[np.ndarray, "hinge 2"]


@lru_cache(maxsize=16)
def network(shape: MeshShape) -> Network:
    """Build the network of a mesh shape."""
    cells = np.arange(shape.cells_y), np.arange(shape.cells_x)
    rows, columns = np.arange(shape.nodes_y), np.arange(shape.nodes_x)
    first_line = 0 if shape.periodic else 1

    def elements(grid: np.ndarray, offsets: list[tuple[int, int]]) -> Elements:
        places = grid[:, None, :] + np.array(offsets)
        turns, wrapped = np.divmod(places, (shape.nodes_y, shape.nodes_x))
        nodes = wrapped[..., 0] * shape.nodes_x + wrapped[..., 1]
        return Elements(nodes, turns[..., ::-1], shape)

    def joined(*kinds: Elements) -> Elements:
        nodes = np.concatenate([kind.nodes for kind in kinds])
        return Elements(nodes, np.concatenate([kind.images for kind in kinds]), shape)

    weft = elements(_grid(rows, cells[1]), [(0, 0), (0, 1)])
    warp = elements(_grid(cells[0], columns), [(0, 0), (1, 0)])
    rising = elements(_grid(*cells), [(0, 0), (1, 1)])
    falling = elements(_grid(*cells), [(0, 1), (1, 0)])
    spring_kind = np.repeat([0, 1, 2], [len(weft.nodes), len(warp.nodes), 2 * len(rising.nodes)])

    wale_cells = _grid(cells[0], cells[1][first_line:])
    wale = elements(wale_cells, [(0, 0), (1, 0), (0, -1), (1, -1), (0, 1), (1, 1)])
    # The edge runs towards −x so that, as for a wale hinge, a mountain has a positive angle.
    course_cells = _grid(cells[0][first_line:], cells[1])
    course = elements(course_cells, [(0, 1), (0, 0), (-1, 1), (-1, 0), (1, 1), (1, 0)])

    return Network(
        shape=shape,
        springs=joined(weft, warp, rising, falling),
        weft=spring_kind == 0,
        warp=spring_kind == 1,
        hinges=joined(wale, course),
        wale=np.arange(len(wale_cells) + len(course_cells)) < len(wale_cells),
        hinge_cells=np.concatenate([wale_cells, course_cells]),
    )


def _grid(rows: np.ndarray, columns: np.ndarray) -> Int[np.ndarray, "place 2"]:
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
