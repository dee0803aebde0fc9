"""Gaps: distances between electrodes of panels, and whether these pass through each other."""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.measure.intersections import TOUCHING, pass_through

Panels = Float[np.ndarray, "_ 4 3"]
Triangles = Float[np.ndarray, "_ 3 3"]
Points = Float[np.ndarray, "... 3"]

HALVES = np.array([[0, 1, 2], [0, 2, 3]])
EDGES = ((0, 1), (1, 2), (2, 0))
FLAT = 1e-12
"""Determinant relative to its largest possible value, below which it counts as zero."""


def gap_between(
    panels: Panels,
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
    others = _with_images(panels[electrode == 1], period)
    one, other = _near(panels[electrode == 0], others, reach)
    if _through(one, other).any():
        return 0.0
    return min(
        float(triangle_distance(one[:, half], other[:, half_of_other]).min(initial=reach))
        for half, half_of_other in itertools.product(HALVES, HALVES)
    )


def crosses_itself(panels: Panels, period: Float[np.ndarray, "3"] | None = None) -> bool:
    """Whether panels of a surface, which may be periodic, pass through each other."""
    return bool(_through(*_near(panels, _with_images(panels, period), 0.0)).any())


def _through(one: Panels, other: Panels) -> Bool[np.ndarray, " pair"]:
    size = np.ptp(one, axis=1).max(initial=0.0)
    return pass_through(np.moveaxis(one, 0, -1), np.moveaxis(other, 0, -1), TOUCHING * size)


def _with_images(panels: Panels, period: Float[np.ndarray, "3"] | None) -> Panels:
    if period is None:
        return panels
    return np.concatenate([panels + turn * period for turn in (-1, 0, 1)])


def _near(one: Panels, other: Panels, reach: float) -> tuple[Panels, Panels]:
    """Pairs of panels that may be within reach of each other."""
    centres = one.mean(axis=1), other.mean(axis=1)
    radii = [
        np.linalg.norm(panels - centre[:, None], axis=-1).max()
        for panels, centre in zip((one, other), centres, strict=True)
    ]
    near = cKDTree(centres[0]).sparse_distance_matrix(
        cKDTree(centres[1]), reach + sum(radii), output_type="coo_matrix"
    )
    return one[near.row], other[near.col]


def triangle_distance(one: Triangles, other: Triangles) -> Float[np.ndarray, " pair"]:
    """Shortest distance between triangles that do not pass through each other [mm].

    It is that between two edges, or between a corner and a face.
    """
    distances = [
        segment_distance(one[:, a], one[:, b], other[:, c], other[:, d])
        for a, b in EDGES
        for c, d in EDGES
    ]
    for corner in range(3):
        distances.append(_distance_to_face(one[:, corner], other))
        distances.append(_distance_to_face(other[:, corner], one))
    return np.min(distances, axis=0)


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
