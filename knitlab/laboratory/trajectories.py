"""Trajectories of tracked points, from pixels to the axes of the fabric."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.lib.format import MAGIC_PREFIX

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.table_file import numbers_of, read_table
from knitlab.laboratory.description import MarkersTable, Towards
from knitlab.laboratory.quantities import number
from knitlab.measure.marker_grid import MarkerGrid, NoGrid, find_grid, grid_of_places

Trajectories = Float[np.ndarray, "frame marker 2"]
FRAMES = "write it as in 'frame,marker,x,y'"
PLACES = "write it as in 'marker,row,column'"
MOST_MISSING_LISTED = 5
IN_PICTURE: dict[Towards, tuple[float, float]] = {
    "right": (1.0, 0.0),
    "left": (-1.0, 0.0),
    "up": (0.0, -1.0),
    "down": (0.0, 1.0),
}
"""Directions in pixels, x to the right and y down."""


def read_trajectories(path: Path) -> Trajectories:
    """Read trajectories in pixels; NaN where a marker is lost.

    Args:
        path: an ``.npy`` array (frame, marker, 2), or a CSV table of frame, marker, x and y.

    Raises:
        BadInput: with every fault of the file.
    """
    if path.suffix == ".npy":
        tracks = _read_array(path)
    elif path.suffix == ".csv":
        tracks = _read_rows(path)
    else:
        raise fault(str(path), "has no suffix .npy or .csv; give one of these")
    if np.isinf(tracks).any():
        frame, marker, _ = np.argwhere(np.isinf(tracks))[0]
        raise fault(
            str(path),
            f"is infinite for marker {marker} in frame {frame}; write NaN where it is lost",
        )
    half_known = np.isnan(tracks).any(axis=2) != np.isnan(tracks).all(axis=2)
    if half_known.any():
        frame, marker = np.argwhere(half_known)[0]
        raise fault(
            str(path), f"has only one coordinate of marker {marker} in frame {frame}; correct it"
        )
    empty = np.flatnonzero(np.isnan(tracks).all(axis=(1, 2)))
    if len(empty):
        listed = ", ".join(map(str, empty[:MOST_MISSING_LISTED]))
        more = ", …" if len(empty) > MOST_MISSING_LISTED else ""
        raise fault(
            str(path),
            f"shows no marker in {len(empty)} frames ({listed}{more}); track them again, or cut"
            " them off",
        )
    return tracks


def _read_array(path: Path) -> Trajectories:
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC_PREFIX)) != MAGIC_PREFIX:
                raise fault(str(path), "is not an .npy array; save it with numpy.save")
        tracks = np.load(path, allow_pickle=False)
    except OSError as error:
        raise fault(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except (ValueError, EOFError) as error:
        problem = (
            "holds pickled objects, which may execute code; save a plain array of floats"
            if "allow_pickle" in str(error)
            else f"is not a complete .npy array ({error}); save it with numpy.save"
        )
        raise fault(str(path), problem) from error
    if not isinstance(tracks, np.ndarray) or tracks.dtype.kind not in "fiu":
        raise fault(str(path), "holds no array of numbers; save one with numpy.save")
    if tracks.ndim != 3 or tracks.shape[2] != 2:
        raise fault(
            str(path), f"has the shape {tracks.shape}; give (frames, markers, 2), x and y in pixels"
        )
    if not tracks.size:
        raise fault(str(path), f"is empty, of shape {tracks.shape}; track some markers")
    return tracks.astype(float)


def _read_rows(path: Path) -> Trajectories:
    """Rows may be in any order; a marker without a row in a frame is lost there."""
    table = _columns(path, ("frame", "marker", "x", "y"), FRAMES, lost=("x", "y"))
    frame, marker = _whole(path, "frame", table["frame"]), _whole(path, "marker", table["marker"])
    names, place = np.unique(marker, return_inverse=True)
    frames, when = np.unique(frame, return_inverse=True)
    if frames[0] > 1:
        problem = f"begins with frame {frames[0]}; number the frames from 0 or 1, the first in time"
        raise fault(f"{path}: column frame", problem)
    if len(gap := np.setdiff1d(np.arange(frames[0], frames[-1] + 1), frames)):
        raise fault(f"{path}: column frame", f"skips {gap[0]}; number the frames consecutively")
    tracks = np.full((len(frames), len(names), 2), np.nan)
    pairs = np.unique(np.stack([when, place], axis=1), axis=0)
    if len(pairs) < len(when):
        raise fault(str(path), "has a marker twice in one frame; keep one row")
    tracks[when, place] = np.stack([table["x"], table["y"]], axis=1)
    return tracks


def _columns(
    path: Path, names: tuple[str, ...], example: str, lost: tuple[str, ...] = ()
) -> dict[str, Float[np.ndarray, " row"]]:
    headers, rows = read_table(path, example)
    headers = [header.strip().lower() for header in headers]
    faults = [
        Fault(f"{path}: column {name}", f"is missing; {example}")
        for name in names
        if name not in headers
    ]
    if not faults and rows.empty:
        faults.append(Fault(str(path), f"has no rows; {example}"))
    if faults:
        raise BadInput(faults)
    columns = {}
    for name in names:
        text = rows[headers.index(name)]
        if name in lost:
            text = text.mask(text.str.strip().str.lower().isin(["", "nan"]))
            columns[name] = np.full(len(text), np.nan)
            given = text.notna().to_numpy()
            columns[name][given], found = numbers_of(path, name, text[given])
        else:
            columns[name], found = numbers_of(path, name, text)
        faults += found
    if faults:
        raise BadInput(faults)
    return columns


def _whole(path: Path, name: str, values: Float[np.ndarray, " row"]) -> np.ndarray:
    bad = np.flatnonzero((values % 1 != 0) | (values < 0))
    if len(bad):
        problem = f"has {values[bad[0]]:g} at point {bad[0] + 1}; count from 0 up"
        raise fault(f"{path}: column {name}", problem)
    return values.astype(int)


def in_fabric_axes(tracks: Trajectories, table: MarkersTable) -> Trajectories:
    """Trajectories along the x and y of the fabric, by the directions of the description [mm].

    Args:
        tracks: trajectories in pixels.
        table: pixel size and orientation.
    """
    axes = np.array([IN_PICTURE[table.weft], IN_PICTURE[table.warp]])
    turn = np.radians(table.turned)
    # In pixels y points down, so that an anticlockwise rotation has the opposite sense.
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return number(table.pixel, "mm") * tracks @ (axes @ rotation.T).T


def grid_of(path: Path, first: Float[np.ndarray, "marker 2"], places: Path | None) -> MarkerGrid:
    """The grid of markers, found in the first frame or read from a table.

    Args:
        path: file of the trajectories, for the message.
        first: the first frame.
        places: table of grid positions, if there is one.

    Raises:
        BadInput: if they are not on a grid, or the table is at fault.
    """
    try:
        if places is None:
            return find_grid(first)
        table = _columns(places, ("marker", "row", "column"), PLACES)
        marker, row, column = (_whole(places, name, table[name]) for name in table)
        if marker.max() >= len(first):
            raise fault(
                f"{places}: column marker",
                f"names marker {marker.max()}, but there are {len(first)}, counted from 0",
            )
        rows, columns = (np.full(len(first), -1) for _ in range(2))
        rows[marker], columns[marker] = row, column
        return grid_of_places(rows, columns)
    except NoGrid as error:
        raise fault(str(places or path), str(error)) from error
