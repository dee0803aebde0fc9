"""SLEAP: a row for each track and frame, with ``NODE.x``, ``NODE.y`` and ``NODE.score``."""

import numpy as np

from knitlab.lab.tracks.track_file import TrackFile, TrackFormat, Tracks

COLUMNS = ("frame_idx", "track", "instance.score")


def _read(file: TrackFile) -> Tracks | None:
    table = file.table_with(*COLUMNS)
    if table is None:
        return None
    nodes = [name[: -len(".x")] for name in table.headers if name.endswith(".x")]
    names = [f"{node}.{each}" for node in nodes for each in ("x", "y", "score")]
    track = table.rows[table.headers.index("track")].to_numpy()
    frames, tracks = file.by_frame(table, "frame_idx", track, names)
    markers = tracks.reshape(len(tracks), -1, 3)
    seen = markers[:, ~np.isnan(markers[..., :2]).all(axis=(0, 2))]
    return Tracks(seen[..., :2], frames, np.nan_to_num(seen[..., 2], nan=1.0))


SLEAP = TrackFormat("SLEAP", _read)
