"""TrackMate: the table of spots, with units in a row below the header."""

import pandas as pd

from knitlab.io.table_file import name_and_unit
from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks

COLUMNS = ("frame", "track_id", "position_x", "position_y")
PIXELS = ("pixel", "pixels", "px")


def _read(file: TrackFile) -> Tracks | None:
    table = file.table_with(*COLUMNS)
    if table is None:
        return None
    columns = zip(table.headers, *table.above, strict=False)
    heads = next(each for each in columns if each[0] == "position_x")
    unit = next(filter(None, (name_and_unit(name)[1] for name in heads[::-1])), "")
    # Spots without a track are not markers.
    track = pd.to_numeric(table.rows[table.headers.index("track_id")], errors="coerce")
    table = table._replace(rows=table.rows[track.notna()].reset_index(drop=True))
    return file.rows_of_positions(table, *COLUMNS, unit="" if unit in PIXELS else unit)


TRACKMATE = TrackFormat("TrackMate", _read)
