"""Gaps: distances between surfaces of panels, and whether they pass through each other."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

Triangles = Float[np.ndarray, "_ 3 3"]
Points = Float[np.ndarray, "... 3"]

HALVES = np.array([[0, 1, 2], [0, 2, 3]])
EDGES = ((0, 1), (1, 2), (2, 0))
FLAT = 1e-12
"""Determinant relative to its largest possible value, below which it counts as zero."""


def gap_between(
    panels: Float[np.ndarray, "panel 4 3"],
    electrode: Int[np.ndarray, " panel"],
    reach: float,
    period: Float[np.ndarray, "3"] | None = None,
) -> float:
    """Shortest distance between two electrodes, 0 where they pass through each other [mm].

    Args:
        panels: corners of the panels, each of which is treated as two triangles.
        electrode: electrode that each panel belongs to, 0 or 1.
        reach: largest distance that is searched; the result is not larger [mm].
        period: of periodic electrodes, from one image to the next [mm].
    """
    triangles = panels[:, HALVES].reshape(-1, 3, 3)
    owner = np.repeat(electrode, len(HALVES))
    others = _with_images(triangles[owner == 1], period)
    one, other = _near(triangles[owner == 0], others, reach)
    if not len(one):
        return reach
    if passes_through(one, other).any():
        return 0.0
    return min(reach, float(triangle_distance(one, other).min()))


def crosses_itself(
    panels: Float[np.ndarray, "panel 4 3"], period: Float[np.ndarray, "3"] | None = None
) -> bool:
    """Whether panels of a surface that are not neighbours pass through each other.

    Args:
        panels: corners of the panels; neighbours have a corner in common.
        period: of a periodic surface, from one image to the next [mm].
    """
    triangles = panels[:, HALVES].reshape(-1, 3, 3)
    one, other = _near(triangles, _with_images(triangles, period), 0.0)
    size = np.ptp(triangles, axis=1).max()
    corners = np.linalg.norm(one[:, :, None] - other[:, None], axis=-1)
    disjoint = corners.min(axis=(1, 2)) > 1e-9 * size
    return bool(passes_through(one[disjoint], other[disjoint]).any())


def _with_images(triangles: Triangles, period: Float[np.ndarray, "3"] | None) -> Triangles:
    if period is None:
        return triangles
    return np.concatenate([triangles + turn * period for turn in (-1, 0, 1)])


def _near(one: Triangles, other: Triangles, reach: float) -> tuple[Triangles, Triangles]:
    """Pairs of triangles that may be within reach of each other."""
    trees, radii = [], []
    for triangles in (one, other):
        centre = triangles.mean(axis=1)
        trees.append(cKDTree(centre))
        radii.append(np.linalg.norm(triangles - centre[:, None], axis=-1).max())
    found = trees[0].sparse_distance_matrix(trees[1], reach + sum(radii), output_type="coo_matrix")
    return one[found.row], other[found.col]


def triangle_distance(one: Triangles, other: Triangles) -> Float[np.ndarray, " pair"]:
    """Shortest distance between triangles that do not pass through each other [mm].

    It is that between two edges, or between a corner and a face.
    """
    found = [
        segment_distance(one[:, a], one[:, b], other[:, c], other[:, d])
        for a, b in EDGES
        for c, d in EDGES
    ]
    for corner in range(3):
        found.append(_distance_to_face(one[:, corner], other))
        found.append(_distance_to_face(other[:, corner], one))
    return np.min(found, axis=0)


def passes_through(one: Triangles, other: Triangles) -> Bool[np.ndarray, " pair"]:
    """Whether an edge of either triangle passes through the other."""
    through = np.zeros(len(one), dtype=bool)
    for edges, faces in ((one, other), (other, one)):
        normal = _normal(faces)
        for a, b in EDGES:
            start, step = edges[:, a], edges[:, b] - edges[:, a]
            climb = _dot(step, normal)
            steep = np.abs(climb) > FLAT * _length(step) * _length(normal)
            part = _dot(faces[:, 0] - start, normal) / np.where(steep, climb, 1)
            meets = steep & (part >= 0) & (part <= 1)
            through |= meets & _over_face(start + part[:, None] * step, faces)
    return through


def segment_distance(
    one: Points, one_end: Points, other: Points, other_end: Points
) -> Float[np.ndarray, "..."]:
    """Shortest distance between segments (Ericson, Real-Time Collision Detection, 5.1.9) [mm]."""
    along, beside, between = one_end - one, other_end - other, one - other
    a, b, c = _dot(along, along), _dot(along, beside), _dot(beside, beside)
    d, e = _dot(along, between), _dot(beside, between)
    tiny = np.finfo(float).tiny
    crossing = a * c - b * b
    s = np.where(crossing > FLAT * a * c, (b * e - c * d) / np.maximum(crossing, tiny), 0.0)
    t = (b * np.clip(s, 0, 1) + e) / np.maximum(c, tiny)
    t = np.clip(t, 0, 1)
    s = np.clip((b * t - d) / np.maximum(a, tiny), 0, 1)
    return _length(between + s[..., None] * along - t[..., None] * beside)


def _distance_to_face(point: Points, face: Triangles) -> Float[np.ndarray, " pair"]:
    """Height above a triangle; infinite beside it."""
    normal = _normal(face)
    size = _length(normal)
    height = np.abs(_dot(point - face[:, 0], normal)) / np.where(size > 0, size, 1)
    return np.where((size > 0) & _over_face(point, face), height, np.inf)


def _over_face(point: Points, face: Triangles) -> Bool[np.ndarray, " pair"]:
    normal = _normal(face)
    inside = np.ones(len(face), dtype=bool)
    for a, b in EDGES:
        side = np.cross(face[:, b] - face[:, a], point - face[:, a])
        inside &= _dot(side, normal) >= 0
    return inside


def _normal(triangles: Triangles) -> Points:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _dot(one: Points, other: Points) -> Float[np.ndarray, "..."]:
    return (one * other).sum(axis=-1)


def _length(vector: Points) -> Float[np.ndarray, "..."]:
    return np.sqrt(_dot(vector, vector))
