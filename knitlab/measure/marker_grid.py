"""Marker grids: which of the tracked points are the corners of which unit cells.

A fabric's markers stand on a grid, distorted, turned by the camera, with some of them missing and
in any order. The grid's two directions are those in which nearest neighbours lie; from the point
where they are seen best it is followed to neighbour after neighbour, those first that lie most
nearly where the neighbours before them predict, so that a doubt in one place is not carried on.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

Points = Float[np.ndarray, "marker 2"]
Step = tuple[int, int]

NONE = -1
MOST_LINES = 10_000
"""Rows or columns of a grid."""
FEWEST = 4
"""Markers that make a unit cell."""
NEIGHBOURS = 8
"""Nearest markers among which the steps of the grid are looked for."""
SECTOR = np.radians(25)
"""How far from a direction of the grid a step along it may point."""
NEAR = 0.5
"""How far from where it is expected a marker may be, as a part of the shorter step."""
STEPS: tuple[Step, ...] = ((0, 1), (1, 0), (0, -1), (-1, 0))
HOPS: tuple[Step, ...] = ((0, 2), (2, 0), (0, -2), (-2, 0), (1, 1), (-1, 1), (-1, -1), (1, -1))
"""Steps over a marker that is missing."""
MOST_STRAYS = 0.25
"""Part of the markers that may stand on no grid."""
UNEVEN = 0.85
"""How far a step may be from the typical one, as a part of it."""
ONE_LINE = "the markers stand in one line, and unit cells have corners in two"


class NoGrid(ValueError):
    """Points that are on no grid, with what to do about it."""


@dataclass(frozen=True)
class MarkerGrid:
    """Rows and columns of markers in a grid.

    Attributes:
        marker: the marker at each place, rows along the warp, columns along the weft; −1 where it
            is missing.
        strays: markers that stand at no place.
    """

    marker: Int[np.ndarray, "row column"]
    strays: tuple[int, ...]

    def corners(
        self, trajectories: Float[np.ndarray, "frame marker 2"]
    ) -> Float[np.ndarray, "frame row column 2"]:
        """Positions of the grid's markers in every frame; NaN where there is none [mm]."""
        nowhere = np.full((len(trajectories), 1, 2), np.nan)
        return np.concatenate([trajectories, nowhere], axis=1)[:, self.marker]


def grid_of_places(
    rows: Int[np.ndarray, " marker"], columns: Int[np.ndarray, " marker"]
) -> MarkerGrid:
    """The grid in which markers have given places; those in a row or column below 0 are strays.

    Raises:
        NoGrid: if two markers have one place.
    """
    placed = np.flatnonzero((rows >= 0) & (columns >= 0))
    rows, columns, strays = (
        rows[placed],
        columns[placed],
        np.flatnonzero((rows < 0) | (columns < 0)),
    )
    if not len(placed):
        raise NoGrid("no marker has a place; give each its row and column")
    if (last := max(rows.max(), columns.max())) >= MOST_LINES:
        raise NoGrid(f"a marker stands in row or column {last}; count them from 0")
    grid = np.full((rows.max() + 1, columns.max() + 1), NONE)
    for marker, row, column in zip(placed, rows, columns, strict=True):
        if grid[row, column] != NONE:
            raise NoGrid(
                f"markers {grid[row, column]} and {marker} both stand in row {row}, column"
                f" {column}; give each a place of its own"
            )
        grid[row, column] = marker
    return MarkerGrid(grid, tuple(strays.tolist()))


def find_grid(points: Points) -> MarkerGrid:
    """Find the grid that points stand on.

    Args:
        points: of every marker (x, y), along the weft and the warp to within 45°; NaN where a
            marker is not seen [mm].

    Raises:
        NoGrid: if there are too few of them, or they stand on no grid.
    """
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(seen) < FEWEST:
        raise NoGrid(
            f"{len(seen)} markers are seen, and a unit cell has {FEWEST}; begin with a frame that"
            " shows them all"
        )
    steps = _steps_of_grid(points[seen])
    places = _followed(points[seen], steps)
    if len(places) < max(FEWEST, (1 - MOST_STRAYS) * len(seen)):
        raise NoGrid(
            f"{len(seen) - len(places)} of {len(seen)} markers stand on no grid that can be"
            " followed; give a table of their places"
        )
    rows, columns = (np.full(len(points), NONE) for _ in range(2))
    found = np.array(list(places))
    rows[seen[found]], columns[seen[found]] = (
        np.array(list(places.values())) - np.min(list(places.values()), axis=0)
    ).T
    grid = grid_of_places(rows, columns)
    if min(grid.marker.shape) < 2:
        raise NoGrid(ONE_LINE)
    _check_even(grid.corners(points[None])[0])
    return MarkerGrid(grid.marker, tuple(stray for stray in grid.strays if stray in seen))


def _steps_of_grid(points: Points) -> Float[np.ndarray, "direction 2"]:
    """Typical steps along the weft and the warp, in this order.

    Raises:
        NoGrid: if neighbours do not lie in two directions.
    """
    tree = cKDTree(points)
    _, near = tree.query(points, k=min(NEIGHBOURS + 1, len(points)))
    between = points[near[:, 1:]] - points[:, None]
    length = np.linalg.norm(between, axis=-1)
    if not length.all():
        raise NoGrid("two markers stand in one point; remove one of them")
    if not np.isfinite(length).all():
        raise NoGrid("the markers are too far apart to be on a fabric; correct the pixel size")
    # Four equal directions are one in the fourfold angle, whichever way the camera is turned.
    nearest = between[:, :2].reshape(-1, 2)
    fourfold = np.exp(4j * np.arctan2(nearest[:, 1], nearest[:, 0])).mean()
    turn = np.angle(fourfold) / 4
    typical = []
    for direction in (turn, turn + np.pi / 2):
        along = np.array([np.cos(direction), np.sin(direction)])
        ahead = between @ along
        in_sector = ahead >= length * np.cos(SECTOR)
        first = np.where(in_sector, length, np.inf).argmin(axis=1)
        able = in_sector.any(axis=1)
        if not able.any():
            raise NoGrid(ONE_LINE)
        typical.append(np.median(between[np.arange(len(points)), first][able], axis=0))
    return np.array(typical)


def _followed(points: Points, steps: Float[np.ndarray, "direction 2"]) -> dict[int, Step]:
    """Places of the points that can be reached from the one with the most regular neighbours."""
    tree = cKDTree(points)
    reach = NEAR * np.linalg.norm(steps, axis=1).min()
    start = _most_regular(points, tree, steps)
    places: dict[int, Step] = {start: (0, 0)}
    taken: dict[Step, int] = {(0, 0): start}
    local = {start: steps}
    for kinds in (STEPS, STEPS + HOPS):
        doubts: list[tuple[float, int, int, Step]] = []
        for point in places:
            _look_around(doubts, point, points, tree, local[point], kinds, reach)
        while doubts:
            _, origin, point, step = heapq.heappop(doubts)
            place = places[origin][0] + step[0], places[origin][1] + step[1]
            if point in places or place in taken:
                continue
            places[point], taken[place] = place, point
            local[point] = _learned(local[origin], step, points[point] - points[origin])
            _look_around(doubts, point, points, tree, local[point], kinds, reach)
    return places


def _check_even(corners: Float[np.ndarray, "row column 2"]) -> None:
    """Refuse a grid of which a step is unlike the others: somewhere the count has slipped.

    Raises:
        NoGrid: if there is such a step.
    """
    for axis, direction in ((0, "row"), (1, "column")):
        steps = np.diff(corners, axis=axis)
        typical = np.nanmedian(steps.reshape(-1, 2), axis=0)
        astray = np.linalg.norm(steps - typical, axis=-1) > UNEVEN * np.linalg.norm(typical)
        if astray.any():
            row, column = np.argwhere(astray)[0]
            raise NoGrid(
                f"the markers cannot be told apart by {direction}s near row {row}, column"
                f" {column}: a step there is not like the others; give a table of their places"
            )


def _most_regular(points: Points, tree: cKDTree, steps: Float[np.ndarray, "direction 2"]) -> int:
    expected = points[:, None] + np.array([sign * step for step in steps for sign in (1, -1)])
    distance, _ = tree.query(expected)
    return int(distance.sum(axis=1).argmin())


def _look_around(
    doubts: list[tuple[float, int, int, Step]],
    point: int,
    points: Points,
    tree: cKDTree,
    steps: Float[np.ndarray, "direction 2"],
    kinds: tuple[Step, ...],
    reach: float,
) -> None:
    """Add the neighbours of a point to those to go to, by how far they are from expected."""
    for step in kinds:
        expected = points[point] + step[1] * steps[0] + step[0] * steps[1]
        distance, neighbour = tree.query(expected, distance_upper_bound=reach)
        if np.isfinite(distance) and neighbour != point:
            hop = abs(step[0]) + abs(step[1]) > 1
            heapq.heappush(doubts, (distance + hop * reach, point, int(neighbour), step))


def _learned(
    steps: Float[np.ndarray, "direction 2"], step: Step, seen: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "direction 2"]:
    """Steps of the grid as they are here, by half from those before and by half from this one."""
    learned = steps.copy()
    for direction, count in ((0, step[1]), (1, step[0])):
        if count and not step[1 - direction]:
            learned[direction] = (steps[direction] + seen / count) / 2
    return learned
