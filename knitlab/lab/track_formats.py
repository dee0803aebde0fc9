"""Files of marker trackers: which columns hold the markers, and which way their y counts.

Trajectories that leave this file are in pixels with x to the right and y down, as in pictures.
"""

import re
from io import StringIO
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy.lib.format import open_memmap

from knitlab.io.errors import invalid, raise_if_any, shortened
from knitlab.io.table_file import Table, column_numbers, name_and_unit, read_table, unit_factor
from knitlab.io.text_file import plain_file, read_text

Trajectories = Float[np.ndarray, "frame marker 2"]
YAxis = Literal["up", "down"]
EXAMPLE = "write it as in 'frame,marker,x,y'"
PIXELS = ("pixel", "pixels", "px")
X_AND_Y = re.compile(r"(?P<before>.*?)[ ._-]?(?P<axis>[xy])[ ._-]?(?P<after>\d*)", re.IGNORECASE)
"""Header of a coordinate in a wide table, such as ``x0``, ``m3.y`` or ``x_12``."""
ROWS = {
    "TrackMate": ("frame", "track_id", "position_x", "position_y"),
    "trackpy": ("frame", "particle", "x", "y"),
    "a picture": ("frame", "marker", "x", "y"),
}
"""Programs that write a row for each position, and their headers in lower case."""
SLEAP = ("frame_idx", "track", "instance.score")


class Tracks(NamedTuple):
    """What a tracker has written: in the axes of its file, or as read with y down."""

    positions: Trajectories  # NaN where a marker is lost
    program: str
    y_axis: YAxis = "down"  # direction in which y increases in the picture
    confidence: Float[np.ndarray, "frame marker"] | None = None  # from 0 to 1, where stated
    unit: str = ""  # of the positions, if it is not the pixel
    summary: tuple[str, ...] = ()  # sentences on what was read, and what was left out


def read_tracks(
    path: Path, y_axis: YAxis | None = None, least_confidence: float = 0.6, pixel: float = 1.0
) -> Tracks:
    """Read the markers of a tracker, with a confidence of at least that, if the format states one.

    Formats are an ``.npy`` array (frame, marker, 2) of tracking-markers, and tables of DeepLabCut,
    SLEAP, TrackMate, trackpy, ``frame,marker,x,y`` and ``x0,y0,x1,y1,…``. ``y_axis`` is the
    direction in which y increases in the picture, by default that of the format, and ``pixel`` the
    size of a pixel on the fabric [mm], which is checked if the file states lengths. InputError if
    positions are incomplete or impossible.
    """
    if path.suffix.lower() == ".npy":
        read = _array(path)
    elif path.suffix.lower() in (".csv", ".txt", ".tsv", ".xlsx"):
        read = _table(path)
    else:
        raise invalid(str(path), "has no suffix .npy or .csv; give one of these")
    if read.unit:
        factor, mistakes = unit_factor(str(path), read.unit, "mm", "of length")
        if mistakes or not np.isclose(factor, pixel):
            stated = f'pixel = {{ value = 1, unit = "{read.unit}" }}'
            raise invalid(str(path), f"has positions in {read.unit}; give {stated}")
    tracks, summary = read.positions, []
    lost = np.isnan(tracks)
    if np.isinf(tracks).any():
        frame, marker, _ = np.argwhere(np.isinf(tracks))[0]
        message = f"is infinite for marker {marker} in frame {frame}; write NaN where it is lost"
        raise invalid(str(path), message)
    if (half_known := lost[..., 0] != lost[..., 1]).any():
        frame, marker = np.argwhere(half_known)[0]
        message = f"has only one coordinate of marker {marker} in frame {frame}; correct it"
        raise invalid(str(path), message)
    up = (y_axis or read.y_axis) == "up"
    stated = "as stated" if y_axis else f"as {read.program} writes it; else give y_axis"
    summary.append(f"y counts {'upwards' if up else 'downwards'}, {stated}")
    confidence = np.inf if read.confidence is None else read.confidence
    unsure = ~lost[..., 0] & (confidence < least_confidence)
    # Programs that lose a marker may write zeros.
    at_origin = (tracks == 0).all(axis=2) & ~unsure
    of_unsure = f"of a confidence below {least_confidence:g}"
    for wrong, which in ((unsure, of_unsure), (at_origin, "at (0, 0)")):
        if wrong.any():
            tracks = np.where(wrong[..., None], np.nan, tracks)
            summary.append(f"{wrong.sum()} positions {which} are left out")
    if len(empty := np.flatnonzero(np.isnan(tracks).all(axis=(1, 2)))):
        listed = ", ".join(map(str, empty[:5])) + (", …" if len(empty) > 5 else "")
        message = f"shows no marker in {len(empty)} frames ({listed})"
        raise invalid(str(path), f"{message}; track them again, or cut them off")
    tracks = tracks * [1.0, -1.0] if up else tracks
    return read._replace(positions=tracks, y_axis="down", summary=tuple(summary))


def _array(path: Path) -> Tracks:
    try:
        tracks = open_memmap(plain_file(path), mode="r")  # which compares sizes
    except OSError as error:
        raise invalid(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except Exception as error:  # numpy raises many types of a damaged header
        why = shortened(" ".join(str(error).split()))
        message = f"is not a complete .npy array ({why}); save it with numpy.save"
        if "magic string" in str(error):
            message = "is not an .npy array; save it with numpy.save"
        elif "Python objects" in str(error):
            message = "holds pickled objects, which may execute code; save a plain array of floats"
        raise invalid(str(path), message) from error
    if tracks.dtype.kind not in "fiu":
        raise invalid(str(path), "holds no array of numbers; save one with numpy.save")
    if tracks.ndim != 3 or tracks.shape[2] != 2:
        message = f"has the shape {tracks.shape}; give (frames, markers, 2), x and y in pixels"
        raise invalid(str(path), message)
    if not tracks.size:
        raise invalid(str(path), f"is empty, of shape {tracks.shape}; track some markers")
    return Tracks(tracks.astype(float), "tracking-markers", y_axis="up")


def _table(path: Path) -> Tracks:
    if path.suffix.lower() != ".xlsx":
        text = read_text(path).lstrip()
        if text.startswith("scorer"):
            return _deeplabcut(path, text)
    table = read_table(path, EXAMPLE)
    for headers in [*table.above, table.headers]:
        lower = [name.lower() for name in headers[: len(table.headers)]]
        if set(SLEAP) <= set(lower):
            return _sleap(path, table._replace(headers=lower))
        for program, columns in ROWS.items():
            if set(columns) <= set(lower):
                return _rows(path, table._replace(headers=lower), program)
    if wide := _wide(path, table):
        return wide
    present = ", ".join(table.headers[:8])
    raise invalid(str(path), f"has no columns of markers, but {present}; {EXAMPLE}")


def _deeplabcut(path: Path, text: str) -> Tracks:
    """Rows ``scorer``, perhaps ``individuals``, ``bodyparts`` and ``coords`` above the numbers."""
    begins = [line.split(",")[0] for line in text.splitlines()[:6]]
    if "coords" not in begins:
        raise invalid(str(path), "begins as a table of DeepLabCut, but has no row coords below")
    try:
        table = pd.read_csv(
            StringIO(text), header=list(range(begins.index("coords") + 1)), index_col=0
        )
        columns = table.apply(pd.to_numeric, errors="raise").to_numpy(float)
    except (ValueError, TypeError, IndexError) as error:
        message = f"begins as a table of DeepLabCut, but is none ({' '.join(str(error).split())})"
        raise invalid(str(path), f"{message}; export it again") from error
    coordinates = [str(name[-1]) for name in table.columns]
    if len(columns) == 0 or coordinates != ["x", "y", "likelihood"] * (len(coordinates) // 3):
        message = "begins as a table of DeepLabCut, but its columns are not x, y, likelihood"
        raise invalid(str(path), f"{message}; export it again")
    of_markers = columns.reshape(len(columns), -1, 3)
    return Tracks(of_markers[..., :2], "DeepLabCut", confidence=of_markers[..., 2])


def _rows(path: Path, table: Table, program: str) -> Tracks:
    """Rows in any order; a marker without a row in a frame is lost there."""
    unit = ""
    if program == "TrackMate":
        # Units are in a row below the header, and spots without a track are not markers.
        columns = zip(table.headers, *table.above, strict=False)
        of_x = next(each for each in columns if each[0] == "position_x")
        unit = next(filter(None, (name_and_unit(name)[1] for name in of_x[::-1])), "")
        track = pd.to_numeric(table.rows[table.headers.index("track_id")], errors="coerce")
        table = table._replace(rows=table.rows[track.notna()].reset_index(drop=True))
    of_frame, of_marker, x, y = ROWS[program]
    marker = whole_numbers(path, of_marker, _column(path, table, of_marker))
    tracks = _by_frame(path, table, of_frame, marker, [x, y])
    return Tracks(tracks, program, unit="" if unit in PIXELS else unit)


def _sleap(path: Path, table: Table) -> Tracks:
    """A row for each track and frame, with ``NODE.x``, ``NODE.y`` and ``NODE.score``."""
    nodes = [name[: -len(".x")] for name in table.headers if name.endswith(".x")]
    names = [f"{node}.{each}" for node in nodes for each in ("x", "y", "score")]
    track = table.rows[table.headers.index("track")].to_numpy()
    of_tracks = _by_frame(path, table, "frame_idx", track, names)
    of_nodes = of_tracks.reshape(len(of_tracks), -1, 3)
    seen = of_nodes[:, ~np.isnan(of_nodes[..., :2]).all(axis=(0, 2))]
    return Tracks(seen[..., :2], "SLEAP", confidence=np.nan_to_num(seen[..., 2], nan=1.0))


def _wide(path: Path, table: Table) -> Tracks | None:
    """One row a frame, with two columns ``x`` and ``y`` for each marker."""
    columns: dict[tuple[str, str], dict[str, int]] = {}
    for number, header in enumerate(table.headers):
        if match := X_AND_Y.fullmatch(name_and_unit(header)[0]):
            before, axis, after = match.group("before", "axis", "after")
            columns.setdefault((before, after), {})[axis.lower()] = number
    pairs = [(each["x"], each["y"]) for each in columns.values() if len(each) == 2]
    if len(pairs) < 2:
        return None
    coordinates = [
        [_column(path, table, table.headers[column], column) for column in pair] for pair in pairs
    ]
    return Tracks(np.array(coordinates).transpose(2, 0, 1), "a picture")


def _column(
    path: Path, table: Table, name: str, column: int | None = None
) -> Float[np.ndarray, " row"]:
    """Numbers of a column, by its header or its index, NaN where it is empty."""
    texts = table.rows[table.headers.index(name) if column is None else column]
    gap = texts.str.lower().isin(["", "nan"])
    values = np.full(len(texts), np.nan)
    values[~gap], mistakes = column_numbers(path, name, texts[~gap])
    raise_if_any(mistakes)
    return values


def whole_numbers(
    path: Path, name: str, values: Float[np.ndarray, " row"]
) -> Int[np.ndarray, " row"]:
    """Values of a column as whole numbers from 0 up; InputError names the first that is none."""
    bad = np.flatnonzero(~((values % 1 == 0) & (values >= 0)))
    if len(bad):
        message = f"has {values[bad[0]]:g} at point {bad[0] + 1}; count from 0 up"
        raise invalid(f"{path}: column {name}", message)
    return values.astype(int)


def _by_frame(
    path: Path, table: Table, frame: str, marker: np.ndarray, names: list[str]
) -> Float[np.ndarray, "frame marker value"]:
    """Columns of rows in any order; NaN where a marker has no row, or the table no such column."""
    known = {name: _column(path, table, name) for name in names if name in table.headers}
    rows = pd.DataFrame(dict.fromkeys(names, np.nan) | known, index=range(len(marker)))
    index = whole_numbers(path, frame, _column(path, table, frame))
    frames = np.unique(index)
    if frames[0] > 1:
        message = f"begins with frame {frames[0]}; number the frames from 0 or 1, the first in time"
        raise invalid(f"{path}: column frame", message)
    if len(gap := np.setdiff1d(np.arange(frames[0], frames[-1] + 1), frames)):
        raise invalid(f"{path}: column frame", f"skips {gap[0]}; number the frames consecutively")
    rows.index = pd.MultiIndex.from_arrays([index, marker])
    if rows.index.has_duplicates:
        raise invalid(str(path), "has a marker twice in one frame; keep one row")
    wide = rows.unstack().to_numpy()
    return wide.reshape(len(frames), len(names), -1).swapaxes(1, 2)
