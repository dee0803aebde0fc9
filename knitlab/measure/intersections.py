"""Intersections: pairs of quadrilaterals, such as grid cells, that pass through each other."""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape
from knitlab.measure.unit_cells import nodes_at

SEGMENTS = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
"""Sides of a quadrilateral and the diagonal that divides it into two triangles, by corner."""
TRIANGLES = np.array([[0, 1, 2], [2, 3, 0]])
"""Triangles of a quadrilateral by corner; the last side of each is the diagonal."""
TOUCHING = 1e-9
"""Depth by which cells must pass through each other to be counted, over the size of a cell."""

# Corners and components come first and pairs last: numpy is slow along short last axes.
Quads = Float[np.ndarray, "4 3 pair"]


def self_intersections(
    shape: MeshShape, configurations: Configuration
) -> Int[np.ndarray, " state"]:
    """Number of pairs of grid cells that pass through each other in each of several states [1].

    A cell is treated as two triangles. A pair counts if a side or the diagonal of one cell crosses
    a triangle of the other by more than 1e-9 times the size of a cell; touching cells do not count.
    Periodic fabric is also compared with its images; each pair counts once per period.
    """
    rows, columns = np.arange(shape.cells_y + 1), np.arange(shape.cells_x + 1)
    nodes = np.asarray(nodes_at(shape, configurations, rows, columns))
    corners = nodes[:, :-1, :-1], nodes[:, :-1, 1:], nodes[:, 1:, 1:], nodes[:, 1:, :-1]
    cells = np.stack([each.reshape(len(nodes), -1, 3) for each in corners], axis=2)
    counts = [
        _pairs_through(quads, lengths if shape.periodic else None)
        for quads, lengths in zip(cells, np.asarray(configurations.lengths), strict=True)
    ]
    return np.array(counts, int)


def _pairs_through(
    cells: Float[np.ndarray, "cell 4 3"], periods: Float[np.ndarray, "2"] | None
) -> int:
    low, high = cells.min(axis=1), cells.max(axis=1)
    tolerance = TOUCHING * float(np.linalg.norm(cells[:, 0] - cells[:, 2], axis=-1).max())
    centre, reach = (low + high) / 2, float(np.linalg.norm(high - low, axis=-1).max())
    tree = cKDTree(centre)
    one, other = tree.query_pairs(reach, output_type="ndarray").T
    pairs = [(one, other, np.zeros((len(one), 3)))]
    if periods is not None:
        for shift in _shifts(centre, reach, periods):
            near = tree.sparse_distance_matrix(
                cKDTree(centre + shift), reach, output_type="coo_matrix"
            )
            pairs.append((near.row, near.col, np.tile(shift, (len(near.row), 1))))
    one, other, shift = (np.concatenate(each) for each in zip(*pairs, strict=True))
    boxes = ((low[one] < high[other] + shift) & (high[one] > low[other] + shift)).all(axis=1)
    quads, others = (
        np.ascontiguousarray(np.moveaxis(each, 0, -1))
        for each in (cells[one[boxes]], cells[other[boxes]] + shift[boxes, None])
    )
    return int(np.count_nonzero(pass_through(quads, others, tolerance)))


def _shifts(
    centre: Float[np.ndarray, "cell 3"], reach: float, periods: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "image 3"]:
    """Displacements of the images within reach of the cells; of two opposite ones the first."""
    most_x, most_y = np.ceil((np.ptp(centre[:, :2], axis=0) + reach) / periods).astype(int)
    steps = itertools.product(range(most_x + 1), range(-most_y, most_y + 1))
    turns = [(*step, 0) for step in steps if step > (0, 0)]
    return np.array(turns) * [*periods, 0.0]


def pass_through(quads: Quads, others: Quads, tolerance: float) -> Bool[np.ndarray, " pair"]:
    """Which pairs of quadrilaterals pass through each other by more than a length.

    Quadrilaterals that touch, as neighbours do along a side or at a corner, do not.
    """
    return _pierced(quads, others, tolerance) | _pierced(others, quads, tolerance)


def _pierced(quads: Quads, others: Quads, tolerance: float) -> Bool[np.ndarray, " pair"]:
    """Which quadrilaterals have a segment that crosses a triangle of the other of their pair."""
    pierced = np.zeros(quads.shape[-1], bool)
    for triangle in TRIANGLES:
        corners = others[triangle]
        normal = _unit(np.cross(corners[1] - corners[0], corners[2] - corners[0], axis=0))
        height = ((quads - corners[0]) * normal).sum(axis=1)
        # Most quadrilaterals are on one side of the plane.
        both = (height.min(axis=0) < -tolerance) & (height.max(axis=0) > tolerance)
        place = np.flatnonzero(both & ~pierced)
        for start, end in SEGMENTS:
            above, below = height[start, place], height[end, place]
            crossing = (above * below < 0) & (np.minimum(abs(above), abs(below)) > tolerance)
            pair, above, below = place[crossing], above[crossing], below[crossing]
            fraction = above / (above - below)
            point = quads[start][:, pair] * (1 - fraction) + quads[end][:, pair] * fraction
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
        inward = np.cross(normal, along, axis=0)
        inside &= ((point - corners[side]) * inward).sum(axis=0) > least
    return inside


def _unit(vector: Float[np.ndarray, "3 pair"]) -> Float[np.ndarray, "3 pair"]:
    return vector / (np.sqrt((vector**2).sum(axis=0)) + np.finfo(float).tiny)
