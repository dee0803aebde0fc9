"""Wide tables: one row a frame, with two columns ``x`` and ``y`` for each marker."""

import re

import numpy as np

from knitlab.io.table_file import name_and_unit
from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks

X_AND_Y = re.compile(r"(?P<before>.*?)[ ._-]?(?P<axis>[xy])[ ._-]?(?P<after>\d*)", re.IGNORECASE)
"""Header of a coordinate, such as ``x0``, ``m3.y`` or ``x_12``."""


def _read(file: TrackFile) -> Tracks | None:
    columns: dict[tuple[str, str], dict[str, int]] = {}
    for number, header in enumerate(file.table.headers if file.is_table else ()):
        if match := X_AND_Y.fullmatch(name_and_unit(header)[0]):
            before, axis, after = match.group("before", "axis", "after")
            columns.setdefault((before, after), {})[axis.lower()] = number
    pairs = [(each["x"], each["y"]) for each in columns.values() if len(each) == 2]
    if len(pairs) < 2:
        return None
    coordinates = [
        [file.column(file.table, file.table.headers[number], number) for number in pair]
        for pair in pairs
    ]
    return Tracks(np.array(coordinates).transpose(2, 0, 1))


WIDE = TrackFormat("a picture", _read)
