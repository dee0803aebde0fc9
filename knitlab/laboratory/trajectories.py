"""Trajectories of tracked points, from pixels to the axes of the fabric, and their grid."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.lib.format import MAGIC_PREFIX

from knitlab.io.errors import fault
from knitlab.io.table_file import read_columns
from knitlab.laboratory.description import MarkersTable, Towards
from knitlab.measure.marker_grid import MarkerGrid, NoGrid, find_grid, grid_of_places

Trajectories = Float[np.ndarray, "frame marker 2"]
MOST_MISSING_LISTED = 5
IN_PICTURE: dict[Towards, tuple[float, float]] = {
    "right": (1.0, 0.0),
    "left": (-1.0, 0.0),
    "up": (0.0, -1.0),
    "down": (0.0, 1.0),
}
"""Directions in pixels, x to the right and y down."""


def read_trajectories(path: Path) -> Trajectories:
    """Trajectories in pixels, of an ``.npy`` array or a CSV table; NaN where a marker is lost."""
    if path.suffix not in READERS:
        raise fault(str(path), "has no suffix .npy or .csv; give one of these")
    tracks = READERS[path.suffix](path)
    lost = np.isnan(tracks)
    empty = np.flatnonzero(lost.all(axis=(1, 2)))
    if np.isinf(tracks).any():
        frame, marker, _ = np.argwhere(np.isinf(tracks))[0]
        problem = f"is infinite for marker {marker} in frame {frame}; write NaN where it is lost"
    elif (half_known := lost[..., 0] != lost[..., 1]).any():
        frame, marker = np.argwhere(half_known)[0]
        problem = f"has only one coordinate of marker {marker} in frame {frame}; correct it"
    elif len(empty):
        listed = ", ".join(map(str, empty[:MOST_MISSING_LISTED]))
        more = ", …" if len(empty) > MOST_MISSING_LISTED else ""
        problem = f"shows no marker in {len(empty)} frames ({listed}{more})"
        problem += "; track them again, or cut them off"
    else:
        return tracks
    raise fault(str(path), problem)


def _read_array(path: Path) -> Trajectories:
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC_PREFIX)) != MAGIC_PREFIX:
                raise fault(str(path), "is not an .npy array; save it with numpy.save")
        tracks = np.load(path, allow_pickle=False)
    except OSError as error:
        raise fault(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except (ValueError, EOFError) as error:
        problem = f"is not a complete .npy array ({error}); save it with numpy.save"
        if "allow_pickle" in str(error):
            problem = "holds pickled objects, which may execute code; save a plain array of floats"
        raise fault(str(path), problem) from error
    if tracks.dtype.kind not in "fiu":
        raise fault(str(path), "holds no array of numbers; save one with numpy.save")
    if tracks.ndim != 3 or tracks.shape[2] != 2:
        problem = f"has the shape {tracks.shape}; give (frames, markers, 2), x and y in pixels"
        raise fault(str(path), problem)
    if not tracks.size:
        raise fault(str(path), f"is empty, of shape {tracks.shape}; track some markers")
    return tracks.astype(float)


def _read_rows(path: Path) -> Trajectories:
    """Rows may be in any order; a marker without a row in a frame is lost there."""
    table = _columns(path, ("frame", "marker", "x", "y"))
    frames, frame = np.unique(_integers(path, "frame", table), return_inverse=True)
    markers, marker = np.unique(_integers(path, "marker", table), return_inverse=True)
    if frames[0] > 1:
        problem = f"begins with frame {frames[0]}; number the frames from 0 or 1, the first in time"
        raise fault(f"{path}: column frame", problem)
    if len(gap := np.setdiff1d(np.arange(frames[0], frames[-1] + 1), frames)):
        raise fault(f"{path}: column frame", f"skips {gap[0]}; number the frames consecutively")
    if len(np.unique(np.stack([frame, marker], axis=1), axis=0)) < len(frame):
        raise fault(str(path), "has a marker twice in one frame; keep one row")
    tracks = np.full((len(frames), len(markers), 2), np.nan)
    tracks[frame, marker] = np.stack([table["x"], table["y"]], axis=1)
    return tracks


READERS = {".npy": _read_array, ".csv": _read_rows}


def _columns(path: Path, names: tuple[str, ...]) -> dict[str, Float[np.ndarray, " row"]]:
    example = f"write it as in '{','.join(names)}'"
    return read_columns(path, dict.fromkeys(names), example, lower=True, with_gaps=("x", "y"))


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
