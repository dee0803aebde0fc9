"""Surfaces of quadrilaterals, such as grid cells: where they pass through each other, and gaps."""

import itertools

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from knitlab.model.cell_grid import nodes_at
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape

SEGMENTS = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
"""Sides of a quadrilateral and the diagonal that divides it into two triangles, by corner."""
TRIANGLES = np.array([[0, 1, 2], [2, 3, 0]])
"""Triangles of a quadrilateral by corner; the last side of each is the diagonal."""
TOUCHING = 1e-9  # least depth of a crossing, over the size of a quadrilateral
EDGES = ((0, 1), (1, 2), (2, 0))
FLAT = 1e-12  # determinant relative to its largest possible value, below which it counts as zero

Quads = Float[np.ndarray, "_ 4 3"]
Triangles = Float[np.ndarray, "_ 3 3"]
Points = Float[np.ndarray, "... 3"]
Periods = tuple[float, float]  # along x and y, 0 along an axis without images [mm]


def self_intersections(shape: MeshShape, configurations: Configuration) -> list[int]:
    """Number of pairs of grid cells that pass through each other, per period, in each state [1]."""
    rows = np.arange(shape.cells_y + 1)
    columns = np.arange(shape.cells_x + 1)
    nodes = np.asarray(nodes_at(shape, configurations, rows, columns))
    corners = nodes[:, :-1, :-1], nodes[:, :-1, 1:], nodes[:, 1:, 1:], nodes[:, 1:, :-1]
    cells = np.stack([each[:, shape.has_fabric] for each in corners], axis=2)
    lengths = np.asarray(configurations.lengths) * shape.periodic
    of_states = zip(cells, lengths, strict=True)
    return [crossings(quads, (x, y), *shear) for quads, (x, y, *shear) in of_states]


def crossings(quads: Quads, periods: Periods = (0.0, 0.0), shear: float = 0.0) -> int:
    """Number of pairs of quadrilaterals, or of one and an image, that pass through each other.

    A pair counts if a side or the diagonal of one crosses a triangle of the other by more than 1e-9
    of its size. Images along y are shifted along x by ``shear`` [mm].
    """
    low = quads.min(axis=1)
    high = quads.max(axis=1)
    centre = (low + high) / 2
    reach = float(np.linalg.norm(high - low, axis=-1).max())
    tree = cKDTree(centre)
    one, other = tree.query_pairs(reach, output_type="ndarray").T
    pairs = [(one, other, np.zeros((len(one), 3)))]
    extents = np.ptp(centre[:, :2], axis=0) + reach
    if periods[1]:
        extents[0] += abs(shear) * np.ceil(extents[1] / periods[1])
    images = [
        int(np.ceil(extent / period)) if period else 0
        for extent, period in zip(extents, periods, strict=True)
    ]
    for turns in itertools.product(range(images[0] + 1), range(-images[1], images[1] + 1)):
        # Of two opposite images one is enough to find a pair.
        if turns > (0, 0):
            shift = np.array([*np.multiply(turns, periods), 0.0])
            shift[0] += turns[1] * shear
            near = _near(tree, centre + shift, reach)
            pairs.append((*near, np.tile(shift, (len(near[0]), 1))))
    one, other, shift = (np.concatenate(each) for each in zip(*pairs, strict=True))
    boxes = ((low[one] < high[other] + shift) & (high[one] > low[other] + shift)).all(axis=1)
    return int(_cross(quads[one[boxes]], quads[other[boxes]] + shift[boxes, None]).sum())


def gap_between(one: Quads, other: Quads, reach: float, periods: Periods = (0.0, 0.0)) -> float:
    """Shortest distance between two surfaces, 0 if they cross and at most ``reach`` [mm]."""
    shifts = [np.array([*np.multiply(turn, periods), 0.0]) for turn in (-1, 0, 1)]
    other = np.concatenate([other + shift for shift in (shifts if any(periods) else shifts[1:2])])
    centres = one.mean(axis=1), other.mean(axis=1)
    radii = [
        float(np.linalg.norm(quads - centre[:, None], axis=-1).max())
        for quads, centre in zip((one, other), centres, strict=True)
    ]
    first, second = _near(cKDTree(centres[0]), centres[1], reach + sum(radii))
    one = one[first]
    other = other[second]
    if _cross(one, other).any():
        return 0.0
    return min(
        float(triangle_distance(one[:, half], other[:, half_of_other]).min(initial=reach))
        for half, half_of_other in itertools.product(TRIANGLES, TRIANGLES)
    )


def _near(tree: cKDTree, points: Points, reach: float) -> tuple[np.ndarray, np.ndarray]:
    near = tree.sparse_distance_matrix(cKDTree(points), reach, output_type="coo_matrix")
    return near.row, near.col


def _cross(quads: Quads, others: Quads) -> Bool[np.ndarray, " pair"]:
    if not len(quads):
        return np.zeros(0, bool)
    tolerance = TOUCHING * float(np.linalg.norm(quads[:, 0] - quads[:, 2], axis=-1).max())
    # Corners and components come first and pairs last: numpy is slow along short last axes.
    one, other = (np.ascontiguousarray(np.moveaxis(each, 0, -1)) for each in (quads, others))
    return _pierced(one, other, tolerance) | _pierced(other, one, tolerance)


def _pierced(
    quads: Float[np.ndarray, "4 3 pair"], others: Float[np.ndarray, "4 3 pair"], tolerance: float
) -> Bool[np.ndarray, " pair"]:
    """Which quadrilaterals have a segment that crosses a triangle of the other of their pair."""
    pierced = np.zeros(quads.shape[-1], bool)
    for triangle in TRIANGLES:
        corners = others[triangle]
        normal = _unit(np.cross(corners[1] - corners[0], corners[2] - corners[0], axis=0))
        height = ((quads - corners[0]) * normal).sum(axis=1)
        # Most quadrilaterals are on one side of the plane.
        both = (height.min(axis=0) < -tolerance) & (height.max(axis=0) > tolerance)
        pairs = np.flatnonzero(both & ~pierced)
        for start, end in SEGMENTS:
            above = height[start, pairs]
            below = height[end, pairs]
            crossing = (above * below < 0) & (np.minimum(abs(above), abs(below)) > tolerance)
            pair = pairs[crossing]
            above = above[crossing]
            below = below[crossing]
            fraction = above / (above - below)
            point = quads[start][:, pair] * (1 - fraction) + quads[end][:, pair] * fraction
            inside = np.ones(len(pair), bool)
            # The last side, the diagonal, belongs to the triangle; the others do not.
            for side, least in enumerate((tolerance, tolerance, -tolerance)):
                along = _unit(corners[(side + 1) % 3][:, pair] - corners[side][:, pair])
                inward = np.cross(normal[:, pair], along, axis=0)
                inside &= ((point - corners[side][:, pair]) * inward).sum(axis=0) > least
            pierced[pair] |= inside
    return pierced


def _unit(vector: Float[np.ndarray, "3 pair"]) -> Float[np.ndarray, "3 pair"]:
    return vector / (np.sqrt((vector**2).sum(axis=0)) + np.finfo(float).tiny)


def triangle_distance(one: Triangles, other: Triangles) -> Float[np.ndarray, " pair"]:
    """Shortest distance between triangles that do not pass through each other [mm]."""
    distances = [
        segment_distance(one[:, a], one[:, b], other[:, c], other[:, d])
        for (a, b), (c, d) in itertools.product(EDGES, EDGES)
    ]
    for face, corners in ((other, one), (one, other)):
        distances += [_distance_to_face(corners[:, corner], face) for corner in range(3)]
    return np.min(distances, axis=0)


def segment_distance(
    one: Points, one_end: Points, other: Points, other_end: Points
) -> Float[np.ndarray, "..."]:
    """Shortest distance between segments (Ericson, Real-Time Collision Detection, 5.1.9) [mm]."""
    along = one_end - one
    beside = other_end - other
    between = one - other
    a = _dot(along, along)
    b = _dot(along, beside)
    c = _dot(beside, beside)
    d = _dot(along, between)
    e = _dot(beside, between)
    tiny = np.finfo(float).tiny
    crossing = a * c - b * b
    s = np.where(crossing > FLAT * a * c, (b * e - c * d) / np.maximum(crossing, tiny), 0.0)
    t = np.clip((b * np.clip(s, 0, 1) + e) / np.maximum(c, tiny), 0, 1)
    s = np.clip((b * t - d) / np.maximum(a, tiny), 0, 1)
    return np.linalg.norm(between + s[..., None] * along - t[..., None] * beside, axis=-1)


def _distance_to_face(point: Points, face: Triangles) -> Float[np.ndarray, " pair"]:
    """Height above a triangle; infinite beside it."""
    normal = np.cross(face[:, 1] - face[:, 0], face[:, 2] - face[:, 0])
    size = np.linalg.norm(normal, axis=-1)
    height = np.abs(_dot(point - face[:, 0], normal)) / np.where(size > 0, size, 1)
    sides = [np.cross(face[:, b] - face[:, a], point - face[:, a]) for a, b in EDGES]
    above = np.all([_dot(side, normal) >= 0 for side in sides], axis=0)
    return np.where((size > 0) & above, height, np.inf)


def _dot(one: Points, other: Points) -> Float[np.ndarray, "..."]:
    return (one * other).sum(axis=-1)
