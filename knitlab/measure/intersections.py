"""Intersections: how many pairs of grid cells of a fabric pass through each other."""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.measure.places import nodes_at
from knitlab.model.network import MeshShape

CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
"""Corners (y, x) of a cell, in order around it."""
SEGMENTS = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
"""Sides of a cell and the diagonal that cuts it in two triangles, by corner."""
TRIANGLES = np.array([[0, 1, 2], [2, 3, 0]])
"""Triangles of a cell by corner; the last side of each is the diagonal."""
TOUCHING = 1e-9
"""Part of a cell's size by which cells have to pass through each other to be counted."""

Cells = Float[np.ndarray, "cell 4 3"]
Boxes = Float[np.ndarray, "2 cell 3"]


def self_intersections(
    shape: MeshShape, configurations: Float[np.ndarray, "state unknown"]
) -> Int[np.ndarray, " state"]:
    """How many pairs of grid cells pass through each other in each state [1].

    A cell is taken as two triangles along one of its diagonals. A pair counts where a side or the
    diagonal of one crosses a triangle of the other, by more than 1e-9 of a cell's size; cells that
    only touch do not. Periodic fabric is compared with its images too, each pair once a period.

    Args:
        shape: mesh of the fabric.
        configurations: node coordinates of each state, then L_x and L_y [mm].
    """
    return np.array([_intersections(shape, configuration) for configuration in configurations])


def _intersections(shape: MeshShape, configuration: Float[np.ndarray, " unknown"]) -> int:
    rows, columns = np.arange(shape.cells_y + 1), np.arange(shape.cells_x + 1)
    nodes = np.asarray(nodes_at(shape, configuration, rows, columns))
    lattice = np.array([[0, configuration[-1], 0], [configuration[-2], 0, 0]])
    # Corners are named by their row and column, past the seam too, so that shared ones are known.
    names = np.indices((shape.cells_y, shape.cells_x)).reshape(2, -1).T[:, None] + CORNERS
    cells = nodes[names[..., 0], names[..., 1]]
    boxes = np.stack([cells.min(axis=1), cells.max(axis=1)])
    tolerance = TOUCHING * np.linalg.norm(cells[:, 0] - cells[:, 2], axis=-1).max()
    found = []
    for turns in _images(shape, boxes, lattice):
        one, other = _overlapping(boxes, boxes + turns @ lattice, tolerance)
        distinct = (one < other) | turns.any()
        found.append((one[distinct], other[distinct], np.tile(turns, (distinct.sum(), 1))))
    one, other, turns = (np.concatenate(each) for each in zip(*found, strict=True))
    moved = cells[other] + (turns @ lattice)[:, None]
    renamed = names[other] + (turns * (shape.cells_y, shape.cells_x))[:, None]
    shared = (names[one][:, :, None] == renamed[:, None]).all(axis=-1)
    pierced = _pierced(
        np.concatenate([cells[one], moved]),
        np.concatenate([moved, cells[one]]),
        np.concatenate([shared, shared.swapaxes(1, 2)]),
        tolerance,
    )
    return int(np.count_nonzero(pierced.reshape(2, -1).any(axis=0)))


def _images(
    shape: MeshShape, boxes: Boxes, lattice: Float[np.ndarray, "2 3"]
) -> list[Int[np.ndarray, " 2"]]:
    """Periods (y, x) by which the fabric is moved to meet itself, one of two opposite ones."""
    if not shape.periodic:
        return [np.zeros(2, int)]
    extent = boxes[1].max(axis=0) - boxes[0].min(axis=0)
    reach_y, reach_x = (extent[[1, 0]] / lattice.max(axis=1)).astype(int)
    turns = itertools.product(range(reach_y + 1), range(-reach_x, reach_x + 1))
    return [np.array(each) for each in turns if each >= (0, 0)]


def _overlapping(
    boxes: Boxes, others: Boxes, tolerance: float
) -> tuple[Int[np.ndarray, " pair"], Int[np.ndarray, " pair"]]:
    """Pairs of one cell and another whose bounding boxes overlap."""
    (ours,) = np.nonzero(_meet(boxes, others[0].min(axis=0), others[1].max(axis=0), tolerance))
    (theirs,) = np.nonzero(_meet(others, boxes[0].min(axis=0), boxes[1].max(axis=0), tolerance))
    centres, other_centres = boxes[:, ours].mean(axis=0), others[:, theirs].mean(axis=0)
    # Boxes overlap only where their centres are within a box of each other.
    widest = np.ptp(boxes, axis=0).max(axis=0) + tolerance
    near = cKDTree(centres / widest).sparse_distance_matrix(
        cKDTree(other_centres / widest), 1.0, p=np.inf, output_type="coo_matrix"
    )
    one, other = ours[near.row], theirs[near.col]
    kept = _meet(boxes[:, one], others[0][other], others[1][other], tolerance)
    return one[kept], other[kept]


def _meet(
    boxes: Boxes, low: Float[np.ndarray, "*any 3"], high: Float[np.ndarray, "*any 3"], within: float
) -> Bool[np.ndarray, " cell"]:
    """Which boxes overlap others, or are within a length of it: flat ones have no volume."""
    return (np.minimum(boxes[1], high) - np.maximum(boxes[0], low) > -within).all(axis=-1)


def _pierced(
    cells: Cells, others: Cells, shared: Bool[np.ndarray, "cell 4 4"], tolerance: float
) -> Bool[np.ndarray, " cell"]:
    """Which cells have a segment that crosses a triangle of the other cell of their pair.

    Args:
        cells: one cell of each pair.
        others: the other.
        shared: which corner of the one is which of the other.
        tolerance: length by which a segment has to cross [mm].
    """
    found = np.zeros(len(cells), bool)
    for triangle in TRIANGLES:
        corners = others[:, triangle]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + np.finfo(float).tiny
        height = np.einsum("pcx,px->pc", cells - corners[:, :1], normal)
        held = np.any(shared[:, :, triangle], axis=-1)
        for start, end in SEGMENTS:
            above, below = height[:, start], height[:, end]
            apart = (above * below < 0) & (np.minimum(abs(above), abs(below)) > tolerance)
            place = np.flatnonzero(apart & ~(held[:, start] | held[:, end]))
            if place.size:
                share = (above[place] / (above - below)[place])[:, None]
                point = cells[place, start] * (1 - share) + cells[place, end] * share
                found[place] |= _inside(point, corners[place], normal[place], tolerance)
    return found


def _inside(
    point: Float[np.ndarray, "point 3"],
    corners: Float[np.ndarray, "point 3 3"],
    normal: Float[np.ndarray, "point 3"],
    tolerance: float,
) -> Bool[np.ndarray, " point"]:
    """Which points of a triangle's plane lie within it.

    Its last side, the diagonal of the cell, belongs to it; the others do not.
    """
    side = np.roll(corners, -1, axis=1) - corners
    side /= np.linalg.norm(side, axis=-1, keepdims=True) + np.finfo(float).tiny
    inward = np.cross(normal[:, None], side)
    distance = np.einsum("psx,psx->ps", point[:, None] - corners, inward)
    return (distance > np.array([tolerance, tolerance, -tolerance])).all(axis=-1)
