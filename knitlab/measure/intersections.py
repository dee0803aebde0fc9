"""Intersections: the number of pairs of grid cells that pass through each other."""

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape
from knitlab.measure.grid_nodes import nodes_at
from knitlab.measure.overlapping_boxes import BoxPairs, overlapping_boxes

CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
"""Corners (y, x) of a cell, in order around it."""
SEGMENTS = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
"""Sides of a cell and the diagonal that divides it into two triangles, by corner."""
TRIANGLES = np.array([[0, 1, 2], [2, 3, 0]])
"""Triangles of a cell by corner; the last side of each is the diagonal."""
SIDE_TOWARDS = np.array([[-1, 1, 3], [2, -1, -1], [0, -1, -1]])
"""Index of the side towards the neighbour at an offset of rows and columns (0, 1 or -1)."""
TOUCHING = 1e-9
"""Depth by which cells must pass through each other to be counted, over the size of a cell."""

TOGETHER = 20_000
"""Number of cells, of one or several states, that are compared at once."""

# Corners and components come first and pairs last: numpy is slow along short last axes.
Cells = Float[np.ndarray, "4 3 pair"]


def self_intersections(
    shape: MeshShape, configurations: Configuration
) -> Int[np.ndarray, " state"]:
    """Number of pairs of grid cells that pass through each other in each state [1].

    A cell is treated as two triangles. A pair counts if a side or the diagonal of one cell crosses
    a triangle of the other by more than 1e-9 times the size of a cell; touching cells do not count.
    Periodic fabric is also compared with its images; each pair counts once per period.

    Args:
        shape: mesh of the fabric.
        configurations: configurations of several states, along a leading axis.
    """
    together = max(1, TOGETHER // (shape.cells_y * shape.cells_x))
    counts = [
        _intersections(shape, configurations[first : first + together])
        for first in range(0, len(configurations.lengths), together)
    ]
    return np.concatenate([np.zeros(0, int), *counts])


def _intersections(shape: MeshShape, configurations: Configuration) -> Int[np.ndarray, " state"]:
    rows, columns = np.arange(shape.cells_y + 1), np.arange(shape.cells_x + 1)
    nodes = np.moveaxis(np.asarray(nodes_at(shape, configurations, rows, columns)), -1, 0)
    place = np.indices((shape.cells_y, shape.cells_x)).reshape(2, -1)
    cells = np.stack([nodes[:, :, row, column] for row, column in CORNERS[:, :, None] + place])
    tolerance = TOUCHING * np.linalg.norm(cells[0] - cells[2], axis=0).max()
    low, high = cells.min(axis=0) - tolerance, cells.max(axis=0)
    periods = np.asarray(configurations.lengths)[:, ::-1].T
    pairs = overlapping_boxes(shape, low, high, periods)
    state = pairs.one // place.shape[1]
    corners = cells.reshape(4, 3, -1)
    cells_1, cells_2 = corners.take(pairs.one, -1), corners.take(pairs.other, -1)
    cells_2[:, 1::-1] += pairs.turns * periods[:, state]
    open_to = np.flatnonzero(~_separated(shape, pairs, cells_1, cells_2, tolerance))
    cells_1, cells_2 = cells_1.take(open_to, -1), cells_2.take(open_to, -1)
    crossing = _pierced(cells_1, cells_2, tolerance) | _pierced(cells_2, cells_1, tolerance)
    return np.bincount(state[open_to][crossing], minlength=len(configurations.lengths))


def _separated(
    shape: MeshShape, pairs: BoxPairs, cells: Cells, others: Cells, tolerance: float
) -> Bool[np.ndarray, " pair"]:
    """Which pairs of cells a certain plane separates; other planes may separate the others.

    The plane is perpendicular to the line between their centres; for cells with a common side it
    contains this side.

    Args:
        shape: mesh of the fabric.
        pairs: indices of the cells.
        cells: one cell of each pair.
        others: the other cell of each pair.
        tolerance: length by which both may cross the plane [mm].
    """
    normal = others.sum(axis=0) - cells.sum(axis=0)
    side = _common_side(shape, pairs)
    shares = np.flatnonzero(side >= 0)
    side = side[shares]
    along = _unit((cells[(side + 1) % 4, :, shares] - cells[side, :, shares]).T)
    normal[:, shares] -= (normal[:, shares] * along).sum(axis=0) * along
    last = np.einsum("cip,ip->cp", cells, normal).max(axis=0)
    first = np.einsum("cip,ip->cp", others, normal).min(axis=0)
    return last - first < tolerance * np.sqrt((normal**2).sum(axis=0))


def _common_side(shape: MeshShape, pairs: BoxPairs) -> Int[np.ndarray, " pair"]:
    """Index of the side that one cell shares with the other, else -1."""
    rows = pairs.other // shape.cells_x - pairs.one // shape.cells_x
    columns = pairs.other % shape.cells_x - pairs.one % shape.cells_x
    rows += pairs.turns[0] * shape.cells_y
    columns += pairs.turns[1] * shape.cells_x
    beside = np.flatnonzero(abs(rows) + abs(columns) == 1)
    side = np.full(len(rows), -1)
    side[beside] = SIDE_TOWARDS[rows[beside], columns[beside]]
    return side


def _pierced(cells: Cells, others: Cells, tolerance: float) -> Bool[np.ndarray, " pair"]:
    """Which cells have a segment that crosses a triangle of the other cell of their pair.

    A segment that ends at a corner of the triangle, as in neighbouring cells, does not count.

    Args:
        cells: one cell of each pair.
        others: the other cell of each pair.
        tolerance: length by which a segment must cross the plane of the triangle [mm].
    """
    pierced = np.zeros(cells.shape[-1], bool)
    for triangle in TRIANGLES:
        corners = others[triangle]
        normal = _unit(_cross(corners[1] - corners[0], corners[2] - corners[0]))
        height = ((cells - corners[0]) * normal).sum(axis=1)
        # Most cells are on one side of the plane.
        both = (height.min(axis=0) < -tolerance) & (height.max(axis=0) > tolerance)
        place = np.flatnonzero(both & ~pierced)
        for start, end in SEGMENTS:
            above, below = height[start, place], height[end, place]
            crossing = (above * below < 0) & (np.minimum(abs(above), abs(below)) > tolerance)
            pair, above, below = place[crossing], above[crossing], below[crossing]
            share = above / (above - below)
            point = cells[start][:, pair] * (1 - share) + cells[end][:, pair] * share
            pierced[pair] |= _inside(point, corners[:, :, pair], normal[:, pair], tolerance)
    return pierced


def _inside(
    point: Float[np.ndarray, "3 pair"],
    corners: Float[np.ndarray, "3 3 pair"],
    normal: Float[np.ndarray, "3 pair"],
    tolerance: float,
) -> Bool[np.ndarray, " pair"]:
    """Which points in the plane of a triangle are inside it.

    The last side, the diagonal of the cell, belongs to the triangle; the others do not.
    """
    inside = np.ones(point.shape[-1], bool)
    for side, least in enumerate((tolerance, tolerance, -tolerance)):
        along = _unit(corners[(side + 1) % 3] - corners[side])
        inward = _cross(normal, along)
        inside &= ((point - corners[side]) * inward).sum(axis=0) > least
    return inside


def _cross(
    one: Float[np.ndarray, "3 pair"], other: Float[np.ndarray, "3 pair"]
) -> Float[np.ndarray, "3 pair"]:
    (a, b, c), (x, y, z) = one, other
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x])


def _unit(vector: Float[np.ndarray, "3 pair"]) -> Float[np.ndarray, "3 pair"]:
    return vector / (np.sqrt((vector**2).sum(axis=0)) + np.finfo(float).tiny)
