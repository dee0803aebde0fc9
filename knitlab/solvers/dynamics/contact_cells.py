"""Pairs of grid cells that are close to each other, and how near they may come in a motion.

A grid cell owns its lower left node, the edges that start there and its two triangles, so that
every pair of parts belongs to one pair of cells. Periodic fabric is compared with itself and with
its images above and to the right: other pairs are images of these.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.model.network import MeshShape

CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
"""Steps (y, x) from the lower left node of a cell to its corners."""
NEIGHBOURS = np.array([[0, 1], [1, -1], [1, 0], [1, 1]])
"""Steps (y, x) to half of the neighbours of a cell, or of a period; the others mirror them."""
CLOSE = 0.5  # distance beyond that of listed pairs up to which cells are close, over a cell side
MAX_BLOCKS = 256  # into which a grid is divided, about

Numbers = Int[np.ndarray, " pair"]
Positions = Float[np.ndarray, "node 3"]
Lengths = Float[np.ndarray, "2"]
CellCorners = Float[np.ndarray, "4 3 cell"]
PairCorners = Float[np.ndarray, "4 3 pair"]


@dataclass(frozen=True, eq=False)
class Place:
    """Where the nodes of a fabric are."""

    positions: Positions  # [mm]
    lengths: Lengths  # L_x and L_y [mm]


@dataclass(frozen=True, eq=False)
class CellPairs:
    """Pairs of cells by the numbers of their lower left nodes."""

    one: Numbers
    other: Numbers
    turns: Int[np.ndarray, "2 pair"]  # sides L_x, L_y to the image that the other cell belongs to
    steps: Int[np.ndarray, "2 pair"]  # rows and columns from the one to the other

    def some(self, which: Int[np.ndarray, " some"]) -> "CellPairs":
        """Some of the pairs, by number."""
        columns = (self.one, self.other, self.turns, self.steps)
        return CellPairs(*(np.take(each, which, axis=-1) for each in columns))

    def and_also(self, more: "CellPairs") -> "CellPairs":
        """These and other pairs."""
        return CellPairs(
            np.concatenate([self.one, more.one]),
            np.concatenate([self.other, more.other]),
            np.concatenate([self.turns, more.turns], axis=1),
            np.concatenate([self.steps, more.steps], axis=1),
        )

    def corners(self, of_cells: CellCorners, lengths: Lengths) -> tuple[PairCorners, PairCorners]:
        """Positions of the corners of the first and of the second cells [mm]."""
        one = np.take(of_cells, self.one, axis=2)
        other = np.take(of_cells, self.other, axis=2)
        if self.turns.any():
            other[:, :2] += self.turns * lengths[:, None]
        return one, other

    def gaps(self, of_cells: CellCorners, lengths: Lengths) -> Float[np.ndarray, " pair"]:
        """Gaps between the boxes of the cells [mm]."""
        low = of_cells.min(axis=0)
        high = of_cells.max(axis=0)
        squared = np.zeros(len(self.one))
        turning = self.turns.any()
        for axis in range(3):
            shift = self.turns[axis] * lengths[axis] if turning and axis < 2 else 0.0
            ahead = low[axis][self.other] + shift - high[axis][self.one]
            behind = low[axis][self.one] - high[axis][self.other] - shift
            squared += np.maximum(np.maximum(ahead, behind), 0.0) ** 2
        return np.sqrt(squared)


@dataclass(frozen=True, eq=False)
class CloseCells:
    """Pairs of cells, but for neighbours, that were within a distance of each other."""

    shape: MeshShape
    cell: float  # shortest side of a cell [mm]
    place: Place
    within: float  # [mm]
    between: Float[np.ndarray, "block block"]  # least distance of others, by their blocks [mm]
    pairs: CellPairs

    @classmethod
    def at(cls, shape: MeshShape, cell: float, place: Place, within: float) -> "CloseCells":
        """Those whose boxes are within a distance [mm], and somewhat farther pairs."""
        within = within + CLOSE * cell
        pairs = _close(shape, place, within)
        return cls(shape, cell, place, within, _between(shape, place, within), pairs)

    def spent(self, place: Place) -> float:
        """Part of their margin by which cells that are not close may have approached."""
        before = self.place
        if self.shape.periodic:
            plane = place.lengths / before.lengths
        else:
            spans = (np.ptp(each.positions[:, :2], axis=0) for each in (place, before))
            plane = np.divide(*spans)
        motion = place.positions - before.positions * [*plane, 1.0]
        low, high = blocks(self.shape, motion)
        nearer = np.zeros_like(self.between)
        for axis in range(3):
            spread = high[:, None, axis] - low[None, :, axis]
            nearer += np.maximum(spread, spread.T) ** 2
        left = self.between * min(float(plane.min()), 1.0) - np.sqrt(nearer)
        return float((self.within - left).max()) / (CLOSE * self.cell)


class GridCells(NamedTuple):
    """All cells of a mesh shape; those beyond the edges of a sample own what lies on them."""

    nodes: Int[np.ndarray, "4 cell"]  # numbers of the corners; beyond an edge those on it
    turns: Int[np.ndarray, "2 4 cell"]  # sides L_x, L_y from these to the images that are corners
    outside: Bool[np.ndarray, "4 cell"]  # whether a corner is beyond an edge

    def corners(self, place: Place) -> CellCorners:
        """Positions of the corners of all cells [mm]."""
        at = np.take(place.positions.T, self.nodes, axis=1)
        at[:2] += self.turns * place.lengths[:, None, None]
        return at.transpose(1, 0, 2)


@lru_cache(maxsize=8)
def grid_cells(shape: MeshShape) -> GridCells:
    """The cells of a mesh shape."""
    size = np.array([shape.nodes_y, shape.nodes_x])
    grid = np.indices((shape.nodes_y, shape.nodes_x)).reshape(2, -1) + CORNERS[:, :, None]
    outside = (grid >= size[:, None]).any(axis=1)
    if shape.periodic:
        turns, grid = np.divmod(grid, size[:, None])
        outside = np.zeros_like(outside)
    else:
        turns = np.zeros_like(grid)
        grid = np.minimum(grid, size[:, None] - 1)
    nodes = grid[:, 0] * shape.nodes_x + grid[:, 1]
    return GridCells(nodes.astype(np.int32), turns.transpose(1, 0, 2)[::-1], outside)


def neighbours(
    shape: MeshShape, of_cells: CellCorners
) -> tuple[CellPairs, Bool[np.ndarray, " pair"]]:
    """Pairs of neighbouring cells, and whether they fold by more than a right angle."""
    normals = np.cross(of_cells[2] - of_cells[0], of_cells[3] - of_cells[1], axis=0)
    beside = _beside(shape)
    against = np.zeros(len(beside.one))
    for component in normals:
        against += component[beside.one] * component[beside.other]
    return beside, against <= 0


@lru_cache(maxsize=8)
def _beside(shape: MeshShape) -> CellPairs:
    one = np.repeat(np.arange(shape.nodes), len(NEIGHBOURS))
    steps = np.tile(NEIGHBOURS.T, shape.nodes)
    size = np.array([[shape.nodes_y], [shape.nodes_x]])
    turns, (row, column) = np.divmod(np.stack(np.divmod(one, shape.nodes_x)) + steps, size)
    pairs = CellPairs(one, row * shape.nodes_x + column, turns[::-1], steps)
    return pairs if shape.periodic else pairs.some(np.flatnonzero(~turns.any(axis=0)))


def _close(shape: MeshShape, place: Place, within: float) -> CellPairs:
    of_cells = grid_cells(shape).corners(place)
    low = of_cells.min(axis=0)
    high = of_cells.max(axis=0)
    own = shape.nodes
    cells = number = np.arange(own)
    turns = np.zeros((2, own), int)
    if shape.periodic:
        # Images whose boxes may come near those of the fabric.
        inner = low.min(axis=1, keepdims=True) - within
        outer = high.max(axis=1, keepdims=True) + within
        for period in NEIGHBOURS[:, ::-1]:
            by = np.array([*(period * place.lengths), 0.0])[:, None]
            reaches = ((low + by <= outer) & (high + by >= inner)).all(axis=0)
            image = np.broadcast_to(period[:, None], (2, own))[:, reaches]
            cells = np.concatenate([cells, number[reaches]])
            turns = np.concatenate([turns, image], axis=1)
    # Boxes can only be so close if their centres are, in units of the largest box.
    scale = (high - low).max(axis=1) + within
    centres = (low + high)[:, cells] / 2
    centres[:2] += turns * place.lengths[:, None]
    one, other = cKDTree(centres.T / scale).query_pairs(1.0, p=np.inf, output_type="ndarray").T
    # Images come last, so that the first of a pair is in the fabric if any of them is.
    rows, columns = np.divmod(cells, shape.nodes_x) + turns[::-1] * [
        [shape.nodes_y],
        [shape.nodes_x],
    ]
    row, column = rows[other] - rows[one], columns[other] - columns[one]
    which = np.flatnonzero((one < own) & ((np.abs(row) > 1) | (np.abs(column) > 1)))
    one, other = one[which], other[which]
    steps = np.stack([row[which], column[which]])
    pairs = CellPairs(one, cells[other], turns[:, other], steps)
    return pairs.some(np.flatnonzero(pairs.gaps(of_cells, place.lengths) <= within))


def _between(shape: MeshShape, place: Place, within: float) -> Float[np.ndarray, "block block"]:
    """Least distances of cells of two blocks that are not within a distance [mm]."""
    low, high = blocks(shape, place.positions)
    if shape.periodic:
        return np.full((len(low), len(low)), within)  # their images may be nearer
    gaps = np.maximum(low[:, None] - high, (low[:, None] - high).transpose(1, 0, 2))
    return np.maximum(np.linalg.norm(gaps.clip(0.0), axis=-1), within)


def blocks(
    shape: MeshShape, of_nodes: Float[np.ndarray, "node 3"]
) -> tuple[Float[np.ndarray, "block 3"], Float[np.ndarray, "block 3"]]:
    """Least and greatest vectors of the corners of cells in each block of the grid."""
    side = int(np.ceil(np.sqrt(shape.nodes / MAX_BLOCKS)))
    rows, columns = (np.arange(0, count, side) for count in (shape.nodes_y, shape.nodes_x))
    grid = of_nodes.reshape(shape.nodes_y, shape.nodes_x, 3)
    grid = np.pad(grid, ((0, 1), (0, 1), (0, 0)), "wrap" if shape.periodic else "edge")

    def reduced(function: np.ufunc) -> Float[np.ndarray, "block 3"]:
        along = function.reduceat(function(grid[:-1], grid[1:]), rows, axis=0)
        both = function.reduceat(function(along[:, :-1], along[:, 1:]), columns, axis=1)
        return both.reshape(-1, 3)

    return reduced(np.minimum), reduced(np.maximum)
