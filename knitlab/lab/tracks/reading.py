"""Reading tracked markers: positions in pixels, with x to the right and y down, as in pictures."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from knitlab.io.errors import invalid
from knitlab.io.table_file import unit_factor
from knitlab.lab.tracks.deeplabcut import DEEPLABCUT
from knitlab.lab.tracks.rows import ROWS, TRACKPY
from knitlab.lab.tracks.sleap import SLEAP
from knitlab.lab.tracks.track_file import EXAMPLE, TrackFile, Trajectories, YAxis
from knitlab.lab.tracks.tracking_markers import TRACKING_MARKERS
from knitlab.lab.tracks.trackmate import TRACKMATE
from knitlab.lab.tracks.wide import WIDE

FORMATS = (TRACKING_MARKERS, DEEPLABCUT, SLEAP, TRACKMATE, TRACKPY, ROWS, WIDE)
"""The registry of formats, in the order in which they are tried."""


class ReadTracks(NamedTuple):
    """Positions of markers with y down, NaN where lost, and sentences on how they were read."""

    positions: Trajectories
    summary: tuple[str, ...]


def read_tracks(
    path: Path, y_axis: YAxis | None = None, least_confidence: float = 0.6, pixel: float = 1.0
) -> ReadTracks:
    """Read the markers of a tracker with a confidence; InputError if no format recognises the file.

    ``y_axis`` is by default that of the format; ``pixel`` [mm] is checked against stated lengths.
    """
    file, where = TrackFile(path), str(path)
    for known in FORMATS:
        if (read := known.read(file)) is not None:
            break
    else:
        if not file.is_table:
            raise invalid(where, "has no suffix .npy or .csv; give one of these")
        present = ", ".join(file.table.headers[:8])
        raise invalid(where, f"has no columns of markers, but {present}; {EXAMPLE}")
    tracks, confidence, unit = read
    if unit:
        factor, mistakes = unit_factor(where, unit, "mm", "of length")
        if mistakes or not np.isclose(factor, pixel):
            stated = f'pixel = {{ value = 1, unit = "{unit}" }}'
            raise invalid(where, f"has positions in {unit}; give {stated}")
    lost = np.isnan(tracks)
    if np.isinf(tracks).any():
        frame, marker, _ = np.argwhere(np.isinf(tracks))[0]
        message = f"is infinite for marker {marker} in frame {frame}; write NaN where it is lost"
        raise invalid(where, message)
    if (half_known := lost[..., 0] != lost[..., 1]).any():
        frame, marker = np.argwhere(half_known)[0]
        message = f"has only one coordinate of marker {marker} in frame {frame}; correct it"
        raise invalid(where, message)
    up = (y_axis or known.y_axis) == "up"
    stated = "as stated" if y_axis else f"as {known.program} writes it; else give y_axis"
    summary = [f"y counts {'upwards' if up else 'downwards'}, {stated}"]
    unsure = ~lost[..., 0] & (False if confidence is None else confidence < least_confidence)
    # Programs that lose a marker may write zeros.
    at_origin = (tracks == 0).all(axis=2) & ~unsure
    unsure_text = f"of a confidence below {least_confidence:g}"
    for wrong, which in ((unsure, unsure_text), (at_origin, "at (0, 0)")):
        if wrong.any():
            tracks = np.where(wrong[..., None], np.nan, tracks)
            summary.append(f"{wrong.sum()} positions {which} are left out")
    if len(empty := np.flatnonzero(np.isnan(tracks).all(axis=(1, 2)))):
        listed = ", ".join(map(str, empty[:5])) + (", …" if len(empty) > 5 else "")
        message = f"shows no marker in {len(empty)} frames ({listed})"
        raise invalid(where, f"{message}; track them again, or cut them off")
    return ReadTracks(tracks * [1.0, -1.0] if up else tracks, tuple(summary))
