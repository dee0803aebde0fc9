"""Reading tracked markers: positions in pixels, with x to the right and y down, as in pictures."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import invalid
from knitlab.io.table_file import unit_factor
from knitlab.io.table_readings import Choice
from knitlab.lab.tracks.deeplabcut import DEEPLABCUT
from knitlab.lab.tracks.rows import ROWS, TRACKPY
from knitlab.lab.tracks.sleap import SLEAP
from knitlab.lab.tracks.track_file import (
    EXAMPLE,
    TrackFile,
    TrackFormat,
    Tracks,
    Trajectories,
    YAxis,
)
from knitlab.lab.tracks.tracking_markers import TRACKING_MARKERS
from knitlab.lab.tracks.trackmate import TRACKMATE
from knitlab.lab.tracks.wide import WIDE

FORMATS = (TRACKING_MARKERS, DEEPLABCUT, SLEAP, TRACKMATE, TRACKPY, ROWS, WIDE)
"""The registry of formats, in the order in which they are tried."""
MIN_STEP, MAX_STEP = 0.7, 100.0  # between the times of frames, over the time of a frame


class ReadTracks(NamedTuple):
    """Positions of markers with y down, NaN where lost, and sentences on how they were read."""

    positions: Trajectories  # of the frames that show a marker
    frames: Float[np.ndarray, " frame"]  # their numbers, which determine the time
    summary: tuple[str, ...]


def read_tracks(
    path: Path,
    y_axis: YAxis | None = None,
    least_confidence: float = 0.6,
    pixel: float = 1.0,
    first_frame: int | None = None,
    frame_rate: float | None = None,
    choice: Choice | None = None,
) -> ReadTracks:
    """Read the markers of a tracker with a confidence; InputError if no format recognises the file.

    ``y_axis`` and ``first_frame``, the number of the first frame of the video, are by default those
    of the format; ``pixel`` [mm] and ``frame_rate`` [Hz] are checked against what the file states.
    """
    file, where = TrackFile(path, choice), str(path)
    for known in FORMATS:
        if (read := known.read(file)) is not None:
            break
    else:
        if not file.is_table:
            raise invalid(where, "has no suffix .npy or .csv; give one of these")
        present = ", ".join(file.table.headers[:8])
        raise invalid(where, f"has no columns of markers, but {present}; {EXAMPLE}")
    tracks, confidence, unit = read.positions, read.confidence, read.unit
    if unit and not np.isclose(unit_factor(where, unit, "mm", "of length"), pixel):
        stated = f'pixel = {{ value = 1, unit = "{unit}" }}'
        raise invalid(where, f"has positions in {unit}; give {stated}")
    up = (y_axis or known.y_axis) == "up"
    stated = "as stated" if y_axis else f"as {known.program} writes it; else give y_axis"
    summary = [f"y counts {'upwards' if up else 'downwards'}, {stated}", *file.unread]
    given = ~np.isnan(tracks).all(axis=2)
    unsure = given & (False if confidence is None else confidence < least_confidence)
    # Programs that lose a marker may write zeros.
    at_origin = (tracks == 0).all(axis=2) & ~unsure
    incomplete = given & ~np.isfinite(tracks).all(axis=2) & ~unsure
    unsure_text = f"of a confidence below {least_confidence:g}"
    reasons = {unsure_text: unsure, "at (0, 0)": at_origin, "without a number": incomplete}
    for which, wrong in reasons.items():
        if wrong.any():
            tracks = np.where(wrong[..., None], np.nan, tracks)
            summary.append(f"{wrong.sum()} positions {which} are left out")
    frames, count, counted = _numbered(where, known, read, first_frame, frame_rate)
    shown = np.isfinite(tracks).any(axis=(1, 2))
    if not shown.any():
        hint = "reduce least_confidence" if unsure.any() else "give a video that shows some"
        raise invalid(where, f"shows no marker in any of {count} frames; {hint}")
    if shown.sum() < count:
        counted.append(f"{count - shown.sum()} of {count} frames show no marker")
    order = np.flatnonzero(shown)[np.argsort(frames[shown], kind="stable")]
    tracks = tracks[order] * [1.0, -1.0 if up else 1.0]
    return ReadTracks(tracks, frames[order], (*summary, *counted))


def _numbered(
    where: str, known: TrackFormat, read: Tracks, first: int | None, rate: float | None
) -> tuple[Float[np.ndarray, " frame"], int, list[str]]:
    """The number of each frame from 0, how many frames the video has, and how they are counted."""
    rows = len(read.positions)
    if read.time is not None:
        steps = np.diff(np.sort(read.time))
        step = float(np.median(steps)) if rows > 1 else 1.0
        if not step > 0:
            raise invalid(where, "has several frames at one time; export one track of the video")
        step = float(np.mean(steps[steps < 1.5 * step])) if rows > 1 else step
        if rate and not MIN_STEP < step * rate < MAX_STEP:
            message = f"has frames {step:.4g} s apart, but frame_rate is {rate:.4g} Hz"
            raise invalid(where, f"{message}; correct frame_rate")
        begin = float(read.time.min())
        frames = read.time * rate if rate else (read.time - begin) / step
        late = [f"the clock of the frames begins at {begin:g} s"] if abs(begin) > step else []
        return frames, max(rows, round(float(np.ptp(frames))) + 1), late
    if read.frames is None:
        return np.arange(rows, dtype=float), rows, []
    unique, counts = np.unique(read.frames, return_counts=True)
    if len(unique) < rows:
        message = f"has frame {unique[counts > 1][0]:g} twice; export one track of the video"
        raise invalid(where, message)
    number = int(unique[0])
    if first is None:
        if number > 1 and not known.counts_from_0:
            message = f"begins with frame {number}, which is the first of the video, or not"
            hint = f"give first_frame = {number} if it is, else 0 or 1, as frames are counted"
            raise invalid(where, f"{message}; {hint}")
        first = 0 if known.counts_from_0 else number
    counted = [f"frames are counted from {first}; else give first_frame"] if first else []
    frames = read.frames - first
    return frames, int(frames.max() - min(frames.min(), 0)) + 1, counted
