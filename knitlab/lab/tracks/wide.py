"""Wide tables: one row a frame, with two columns ``x`` and ``y`` for each marker."""

import re

import numpy as np
import pandas as pd

from knitlab.io.table_file import name_and_unit, unit_factor
from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks, whole_numbers

X_AND_Y = re.compile(r"(?P<before>.*?)[ ._-]?(?P<axis>[xy])[ ._-]?(?P<after>\d*)", re.IGNORECASE)
"""Header of a coordinate, such as ``x0``, ``m3.y`` or ``x_12``."""
FRAMES = ("frame", "frames", "frame number", "frame_number", "frame_idx", "frame index", "image")
TIMES = ("time", "timestamp", "elapsed time", "t", "zeit")


def _read(file: TrackFile) -> Tracks | None:
    columns: dict[tuple[str, str], dict[str, int]] = {}
    frames, time = None, None
    for number, header in enumerate(file.table.headers if file.is_table else ()):
        name, unit = name_and_unit(header)
        if name.lower() in FRAMES:
            frames = number
        elif name.lower() in TIMES:
            time = number, unit
        elif match := X_AND_Y.fullmatch(name):
            before, axis, after = match.group("before", "axis", "after")
            columns.setdefault((before, after), {})[axis.lower()] = number
    pairs = [(each["x"], each["y"]) for each in columns.values() if len(each) == 2]
    if len(pairs) < 2:
        return None
    coordinates = [
        [file.column(file.table, file.table.headers[number], number) for number in pair]
        for pair in pairs
    ]
    positions = np.array(coordinates).transpose(2, 0, 1)
    if frames is not None:
        column = file.column(file.table, file.table.headers[frames], frames)
        whole = whole_numbers(file.path, file.table.headers[frames], column)
        return Tracks(positions, whole.astype(float))
    if time is None:
        return Tracks(positions)
    number, unit = time
    seconds = pd.to_numeric(file.table.rows[number], errors="coerce").to_numpy(float)
    if not np.isfinite(seconds).all():  # a time of day
        return Tracks(positions)
    where = f"{file.path}: column {file.table.headers[number]}"
    factor = unit_factor(where, unit or "s", "s", "of time, such as s")
    return Tracks(positions, time=seconds * factor)


WIDE = TrackFormat("a picture", _read, counts_from_0=False)
