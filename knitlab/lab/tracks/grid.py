"""Marker grids: assigning tracked points to the corners of unit cells.

The two directions of a distorted grid are those of nearest neighbours. It is followed from the most
regular point, first to those closest to their predicted positions.
"""

import heapq
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

Points = Float[np.ndarray, "marker 2"]
Steps = Float[np.ndarray, "direction 2"]  # steps along the weft and the warp [mm]
Step = tuple[int, int]  # numbers of rows and of columns from one marker to another

NONE = -1
MAX_LINES = 10_000  # largest number of rows or columns of a grid
MIN_MARKERS = 4  # number of markers of a unit cell
NEIGHBOURS = 8  # number of nearest markers among which steps of the grid are searched
SECTOR = np.radians(25)  # largest angle between a step and the direction of the grid
NEAR = 0.5  # largest distance of a marker from its predicted position, over the shorter step
STEPS = [step for step in product(range(-2, 3), repeat=2) if 1 <= sum(map(abs, step)) <= 2]
"""Steps to neighbours, and over a missing marker."""
MAX_STRAYS = 0.25  # largest fraction of markers that are not on the grid
UNEVEN = 0.85  # largest relative difference of a step from the typical one
ONE_LINE = "the markers are in one line, but the corners of unit cells are in two"


class NoGrid(ValueError):
    """Points that do not form a grid, with the remedy."""


@dataclass(frozen=True)
class MarkerGrid:
    """The marker in each row along the warp and column along the weft, −1 if missing; strays."""

    marker: Int[np.ndarray, "row column"]
    strays: tuple[int, ...]

    def corners(
        self, trajectories: Float[np.ndarray, "frame marker 2"]
    ) -> Float[np.ndarray, "frame row column 2"]:
        """Positions of the markers of the grid in every frame; NaN if missing [mm]."""
        nowhere = np.full((len(trajectories), 1, 2), np.nan)
        return np.concatenate([trajectories, nowhere], axis=1)[:, self.marker]


def placed_grid(
    rows: Int[np.ndarray, " marker"], columns: Int[np.ndarray, " marker"]
) -> MarkerGrid:
    """The grid of markers with given rows and columns, of which negative ones mark strays."""
    on_grid = (rows >= 0) & (columns >= 0)
    if not on_grid.any():
        raise NoGrid("no marker has a row and column; give them for each")
    if (last := max(rows[on_grid].max(), columns[on_grid].max())) >= MAX_LINES:
        raise NoGrid(f"a marker is in row or column {last}; count them from 0")
    grid = np.full((rows[on_grid].max() + 1, columns[on_grid].max() + 1), NONE)
    for marker in np.flatnonzero(on_grid):
        row, column = rows[marker], columns[marker]
        if grid[row, column] != NONE:
            raise NoGrid(
                f"markers {grid[row, column]} and {marker} are both in row {row}, column"
                f" {column}; give each another one"
            )
        grid[row, column] = marker
    return MarkerGrid(grid, tuple(np.flatnonzero(~on_grid).tolist()))


def find_grid(points: Points) -> MarkerGrid:
    """Find the grid of points (x, y), NaN if not seen, that run along weft and warp within 45°."""
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(seen) < MIN_MARKERS:
        raise NoGrid(
            f"{len(seen)} markers are seen, but a unit cell has {MIN_MARKERS}; begin with a frame"
            " that shows all of them"
        )
    positions = _followed(points[seen], _steps_of_grid(points[seen]))
    if len(positions) < max(MIN_MARKERS, (1 - MAX_STRAYS) * len(seen)):
        raise NoGrid(
            f"{len(seen) - len(positions)} of {len(seen)} markers are not on one regular grid;"
            " give a table of their places"
        )
    rows_columns = np.full((2, len(points)), NONE)
    lines = np.array(list(positions.values())).T
    rows_columns[:, seen[list(positions)]] = lines - lines.min(axis=1, keepdims=True)
    grid = placed_grid(*rows_columns)
    if min(grid.marker.shape) < 2:
        raise NoGrid(ONE_LINE)
    _check_even(grid.corners(points[None])[0])
    return MarkerGrid(grid.marker, tuple(stray for stray in grid.strays if stray in seen))


def _steps_of_grid(points: Points) -> Steps:
    _, near = cKDTree(points).query(points, k=min(NEIGHBOURS + 1, len(points)))
    between = points[near[:, 1:]] - points[:, None]
    length = np.linalg.norm(between, axis=-1)
    if not length.all():
        raise NoGrid("two markers are at one point; give a table of places that names one of them")
    if not np.isfinite(length).all():
        raise NoGrid("the markers are too far apart to be on a fabric; correct the pixel size")
    # Multiplying angles by four makes the four directions of the grid equal.
    nearest = between[:, :2].reshape(-1, 2)
    turn = np.angle(np.exp(4j * np.arctan2(nearest[:, 1], nearest[:, 0])).mean()) / 4
    typical = []
    for direction in (turn, turn + np.pi / 2):
        in_sector = (between @ [np.cos(direction), np.sin(direction)]) >= length * np.cos(SECTOR)
        with_step = in_sector.any(axis=1)
        if not with_step.any():
            raise NoGrid(ONE_LINE)
        first = np.where(in_sector, length, np.inf).argmin(axis=1)
        typical.append(np.median(between[np.arange(len(points)), first][with_step], axis=0))
    return np.array(typical)


def _followed(points: Points, steps: Steps) -> dict[int, Step]:
    """Grid positions of the points reachable from the one with the most regular neighbours."""
    tree = cKDTree(points)
    reach = NEAR * np.linalg.norm(steps, axis=1).min()
    nearest = tree.query(points[:, None] + np.concatenate([steps, -steps]))
    start = int(nearest[0].sum(axis=1).argmin())
    expected = points[:, None] + np.array(STEPS) @ steps[::-1]
    distances, neighbours = tree.query(expected, distance_upper_bound=reach)
    positions: dict[int, Step] = {}
    queue = [(0.0, start, (0, 0))]
    while queue:
        _, point, position = heapq.heappop(queue)
        if point in positions or position in positions.values():
            continue
        positions[point] = position
        for (rows, columns), distance, neighbour in zip(
            STEPS, distances[point], neighbours[point], strict=True
        ):
            if np.isfinite(distance) and neighbour != point:
                # Steps over a missing marker come after all others, whose distance is in reach.
                late = reach * (abs(rows) + abs(columns) - 1)
                step_to = position[0] + rows, position[1] + columns
                heapq.heappush(queue, (distance + late, int(neighbour), step_to))
    return positions


def _check_even(corners: Float[np.ndarray, "row column 2"]) -> None:
    """Refuse a grid with a step that differs, as a row or column may have been skipped."""
    for axis, direction in ((0, "row"), (1, "column")):
        steps = np.diff(corners, axis=axis)
        typical = np.nanmedian(steps.reshape(-1, 2), axis=0)
        astray = np.linalg.norm(steps - typical, axis=-1) > UNEVEN * np.linalg.norm(typical)
        if astray.any():
            row, column = np.argwhere(astray)[0]
            raise NoGrid(
                f"the {direction}s of the markers are ambiguous near row {row}, column"
                f" {column}: a step there differs from the others; give a table of their places"
            )
