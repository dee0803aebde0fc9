"""Trajectories of tracked points, from pixels to the axes of the fabric, and their grid."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import fault
from knitlab.io.table_file import read_columns
from knitlab.laboratory.description import MarkersTable, Towards
from knitlab.laboratory.track_formats import Trajectories
from knitlab.measure.marker_grid import MarkerGrid, NoGrid, find_grid, grid_of_places

IN_PICTURE: dict[Towards, tuple[float, float]] = {
    "right": (1.0, 0.0),
    "left": (-1.0, 0.0),
    "up": (0.0, -1.0),
    "down": (0.0, 1.0),
}
"""Directions in pixels, x to the right and y down."""


def _columns(path: Path, names: tuple[str, ...]) -> dict[str, Float[np.ndarray, " row"]]:
    example = f"write it as in '{','.join(names)}'"
    return read_columns(path, dict.fromkeys(names), example, lower=True)


def _integers(path: Path, name: str, table: dict[str, Float[np.ndarray, " row"]]) -> np.ndarray:
    values = table[name]
    bad = np.flatnonzero((values % 1 != 0) | (values < 0))
    if len(bad):
        problem = f"has {values[bad[0]]:g} at point {bad[0] + 1}; count from 0 up"
        raise fault(f"{path}: column {name}", problem)
    return values.astype(int)


def in_fabric_axes(tracks: Trajectories, table: MarkersTable) -> Trajectories:
    """Trajectories in pixels along the x and y of the fabric, by the description [mm]."""
    axes = np.array([IN_PICTURE[table.weft], IN_PICTURE[table.warp]])
    turn = np.radians(table.turned)
    # In pixels y points down, so that an anticlockwise rotation has the opposite sense.
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return table.pixel.to("mm") * tracks @ (axes @ rotation.T).T


def grid_of(path: Path, first: Float[np.ndarray, "marker 2"], places: Path | None) -> MarkerGrid:
    """The grid of markers, found in the first frame of ``path`` or read from a table of places."""
    try:
        if places is None:
            return find_grid(first)
        table = _columns(places, ("marker", "row", "column"))
        marker, row, column = (_integers(places, name, table) for name in table)
        if marker.max() >= len(first):
            problem = f"names marker {marker.max()}, but there are {len(first)}, counted from 0"
            raise fault(f"{places}: column marker", problem)
        rows, columns = np.full((2, len(first)), -1)
        rows[marker], columns[marker] = row, column
        return grid_of_places(rows, columns)
    except NoGrid as error:
        raise fault(str(places or path), str(error)) from error
