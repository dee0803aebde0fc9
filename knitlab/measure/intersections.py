"""Intersections: how many pairs of grid cells of a fabric pass through each other."""

import itertools
from dataclasses import dataclass

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

TOGETHER = 20_000
"""Cells of several states that are compared at once: many states of a small fabric cost little."""

# Corners and components come first and pairs last: numpy is slow along short last axes.
Cells = Float[np.ndarray, "4 3 pair"]


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
    together = max(1, TOGETHER // (shape.cells_y * shape.cells_x))
    counts = [
        _intersections(shape, configurations[first : first + together])
        for first in range(0, len(configurations), together)
    ]
    return np.concatenate([np.zeros(0, int), *counts])


def _intersections(
    shape: MeshShape, configurations: Float[np.ndarray, "state unknown"]
) -> Int[np.ndarray, " state"]:
    rows, columns = np.arange(shape.cells_y + 1), np.arange(shape.cells_x + 1)
    nodes = np.moveaxis(np.asarray(nodes_at(shape, configurations, rows, columns)), -1, 0)
    place = np.indices((shape.cells_y, shape.cells_x)).reshape(2, -1)
    cells = np.stack([nodes[:, :, row, column] for row, column in CORNERS[:, :, None] + place])
    tolerance = TOUCHING * np.linalg.norm(cells[0] - cells[2], axis=0).max()
    pairs = _near_pairs(shape, cells, configurations[:, :-3:-1].T, tolerance)
    ours = cells[:, :, pairs.state, pairs.one]
    theirs = cells[:, :, pairs.state, pairs.other]
    theirs[:, :2] += pairs.offset[::-1]
    crossing = _pierced(ours, theirs, tolerance) | _pierced(theirs, ours, tolerance)
    return np.bincount(pairs.state[crossing], minlength=len(configurations))


@dataclass(frozen=True)
class _Pairs:
    """Pairs of cells whose bounding boxes overlap.

    Attributes:
        state: of each pair.
        one, other: its cells.
        offset: by which the other is moved along y and x [mm].
    """

    state: Int[np.ndarray, " pair"]
    one: Int[np.ndarray, " pair"]
    other: Int[np.ndarray, " pair"]
    offset: Float[np.ndarray, "2 pair"]


def _near_pairs(
    shape: MeshShape,
    cells: Float[np.ndarray, "4 3 state cell"],
    periods: Float[np.ndarray, "2 state"],
    tolerance: float,
) -> _Pairs:
    """Pairs of cells, and of cells and images, whose bounding boxes overlap.

    Args:
        shape: mesh of the fabric.
        cells: corners of the cells of every state.
        periods: L_y and L_x of every state [mm].
        tolerance: length within which boxes overlap too [mm].
    """
    low, high = cells.min(axis=0) - tolerance, cells.max(axis=0)
    lowest, highest = low.min(axis=2, keepdims=True), high.max(axis=2, keepdims=True)
    images = []
    for turns in _images(shape, lowest, highest, periods):
        offset = turns[:, None] * periods
        moved = np.concatenate([offset[::-1], np.zeros((1, offset.shape[1]))])[..., None]
        reaching = ((low + moved < highest) & (high + moved > lowest)).all(axis=0)
        state, cell = np.nonzero(reaching)
        images.append((state, cell, np.tile(turns[:, None], len(state)), offset[:, state]))
    state, other, turns, offset = (
        np.concatenate(each, axis=-1) for each in zip(*images, strict=True)
    )
    # Boxes overlap only where their centres are within a box of each other; states lie far apart.
    widest = (high - low).max(axis=(1, 2))[:, None]
    places = np.indices(low.shape[1:]).reshape(2, -1)
    ours = np.vstack([((low + high) / 2).reshape(3, -1) / widest, 2.0 * places[0]])
    middle = (low[:, state, other] + high[:, state, other]) / 2
    middle[:2] += offset[::-1]
    near = cKDTree(ours.T).sparse_distance_matrix(
        cKDTree(np.vstack([middle / widest, 2.0 * state]).T), 1.0, p=np.inf, output_type="ndarray"
    )
    one, image = places[1][near["i"]], near["j"]
    first = (one < other[image]) | turns[:, image].any(axis=0)
    one, image = one[first], image[first]
    at, found, by = state[image], other[image], offset[:, image]
    kept = np.ones(len(one), bool)
    for axis, moved in enumerate((by[1], by[0], 0.0)):
        top = np.minimum(high[axis, at, one], high[axis, at, found] + moved)
        kept &= top > np.maximum(low[axis, at, one], low[axis, at, found] + moved)
    return _Pairs(at[kept], one[kept], found[kept], by[:, kept])


def _images(
    shape: MeshShape,
    lowest: Float[np.ndarray, "3 state 1"],
    highest: Float[np.ndarray, "3 state 1"],
    periods: Float[np.ndarray, "2 state"],
) -> list[Int[np.ndarray, " 2"]]:
    """Periods (y, x) by which the fabric is moved to meet itself, one of two opposite ones."""
    if not shape.periodic:
        return [np.zeros(2, int)]
    extent = (highest - lowest)[[1, 0], :, 0]
    reach_y, reach_x = (extent / periods).max(axis=1).astype(int)
    turns = itertools.product(range(reach_y + 1), range(-reach_x, reach_x + 1))
    return [np.array(each) for each in turns if each >= (0, 0)]


def _pierced(cells: Cells, others: Cells, tolerance: float) -> Bool[np.ndarray, " pair"]:
    """Which cells have a segment that crosses a triangle of the other cell of their pair.

    A segment that ends in a corner of the triangle, as neighbours have, does not cross its plane by
    the tolerance.

    Args:
        cells: one cell of each pair.
        others: the other.
        tolerance: length by which a segment has to cross [mm].
    """
    found = np.zeros(cells.shape[-1], bool)
    for triangle in TRIANGLES:
        corners = others[triangle]
        normal = _unit(_cross(corners[1] - corners[0], corners[2] - corners[0]))
        height = ((cells - corners[0]) * normal).sum(axis=1)
        # Most cells lie to one side.
        both = (height.min(axis=0) < -tolerance) & (height.max(axis=0) > tolerance)
        place = np.flatnonzero(both & ~found)
        for start, end in SEGMENTS:
            above, below = height[start, place], height[end, place]
            apart = (above * below < 0) & (np.minimum(abs(above), abs(below)) > tolerance)
            at, above, below = place[apart], above[apart], below[apart]
            share = above / (above - below)
            point = cells[start][:, at] * (1 - share) + cells[end][:, at] * share
            found[at] |= _inside(point, corners[:, :, at], normal[:, at], tolerance)
    return found


def _inside(
    point: Float[np.ndarray, "3 pair"],
    corners: Float[np.ndarray, "3 3 pair"],
    normal: Float[np.ndarray, "3 pair"],
    tolerance: float,
) -> Bool[np.ndarray, " pair"]:
    """Which points of a triangle's plane lie within it.

    Its last side, the diagonal of the cell, belongs to it; the others do not.
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
