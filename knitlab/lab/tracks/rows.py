"""Tables with a row for each position: those of trackpy, and any with ``frame,marker,x,y``."""

from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks


def rows_format(program: str, *columns: str, counts_from_0: bool = True) -> TrackFormat:
    """The format of a program that writes frame, marker, x and y in columns of these names."""

    def read(file: TrackFile) -> Tracks | None:
        table = file.table_with(*columns)
        return None if table is None else file.rows_of_positions(table, *columns)

    return TrackFormat(program, read, counts_from_0=counts_from_0)


TRACKPY = rows_format("trackpy", "frame", "particle", "x", "y")
ROWS = rows_format("a picture", "frame", "marker", "x", "y", counts_from_0=False)
