"""DeepLabCut: rows ``scorer``, perhaps ``individuals``, ``bodyparts`` and ``coords`` above."""

from io import StringIO

import pandas as pd

from knitlab.io.errors import invalid
from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks, whole_numbers


def _read(file: TrackFile) -> Tracks | None:
    if not (file.is_table and file.text.startswith("scorer")):
        return None
    begins = [line.split(",")[0] for line in file.text.splitlines()[:6]]
    try:
        if "coords" not in begins:
            raise ValueError("none of its first rows begins with coords")
        header = list(range(begins.index("coords") + 1))
        table = pd.read_csv(StringIO(file.text), header=header, index_col=0)
        columns = table.apply(pd.to_numeric, errors="raise").to_numpy(float)
        coordinates = [str(name[-1]) for name in table.columns]
        if len(columns) == 0 or coordinates != ["x", "y", "likelihood"] * (len(coordinates) // 3):
            raise ValueError("its columns are not x, y, likelihood")
    except (ValueError, TypeError, IndexError) as error:
        message = f"begins as a table of DeepLabCut, but is none ({' '.join(str(error).split())})"
        raise invalid(str(file.path), f"{message}; export it again") from error
    markers = columns.reshape(len(columns), -1, 3)
    number = pd.to_numeric(pd.Series(table.index), errors="coerce").to_numpy(float)
    frames = whole_numbers(file.path, "scorer", number).astype(float)
    return Tracks(markers[..., :2], frames, markers[..., 2])


DEEPLABCUT = TrackFormat("DeepLabCut", _read)
