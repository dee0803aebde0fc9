"""Files of trackers are read as these programs write them, in pixels with y down."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.lab.tracks.reading import read_tracks
from tests.refusals import refused

NAN = np.nan
TRACKS = np.round(np.random.default_rng(3).uniform(50, 900, (6, 5, 2)), 2)
LOST = TRACKS.copy()
LOST[2, 1] = LOST[4:, 3] = NAN
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "cp1252")
SEPARATORS = (",", ";", "\t")


def shown(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def deeplabcut(tracks, levels=3, confidence=0.95):
    """Three columns for each body part, below rows of names."""
    _, markers, _ = tracks.shape
    names = [
        ["scorer", *["DLC_resnet50_knit"] * 3 * markers],
        ["individuals", *["single"] * 3 * markers],
        ["bodyparts", *(str(marker) for marker in range(markers) for _ in range(3))],
        ["coords", *["x", "y", "likelihood"] * markers],
    ]
    rows = [
        [str(frame), *(shown(v) for x, y in points for v in (x, y, confidence))]
        for frame, points in enumerate(tracks)
    ]
    return [row for row in names if levels == 4 or row[0] != "individuals"] + rows


def sleap(tracks):
    """One track with a node for each marker."""
    _, markers, _ = tracks.shape
    header = ["track", "frame_idx", "instance.score"]
    header += [f"m{n}.{name}" for n in range(markers) for name in ("x", "y", "score")]
    return [header] + [
        ["", str(frame), "0.93", *(shown(v) for x, y in points for v in (x, y, 0.9))]
        for frame, points in enumerate(tracks)
    ]


def rows_of(tracks):
    """Frame, marker, x and y of all that are seen, in any order."""
    rows = [
        (frame, marker, *tracks[frame, marker])
        for frame, marker in np.ndindex(tracks.shape[:2])
        if np.isfinite(tracks[frame, marker, 0])
    ]
    return [rows[each] for each in np.random.default_rng(1).permutation(len(rows))]


def trackmate(tracks, unit="pixel"):
    """Four rows of headers, and spots of which one is in no track."""
    header = ["LABEL", "ID", "TRACK_ID", "QUALITY", "POSITION_X", "POSITION_Y", "FRAME"]
    spots = [
        [f"ID{n}", str(n), str(m), "12.5", shown(x), shown(y), str(f)]
        for n, (f, m, x, y) in enumerate(rows_of(tracks))
    ]
    return [
        header,
        ["Label", "Spot ID", "Track ID", "Quality", "X", "Y", "Frame"],
        ["Label", "Spot ID", "Track ID", "Quality", "X", "Y", "Frame"],
        ["", "", "", "(quality)", f"({unit})", f"({unit})", ""],
        *spots,
        ["ID99", "99", "", "3.5", "1.0", "2.0", "0"],
    ]


def trackpy(tracks):
    """An index without a name, y before x, and particles."""
    return [["", "y", "x", "mass", "size", "frame", "particle"]] + [
        [str(n), shown(y), shown(x), "310.5", "2.1", str(f), str(m)]
        for n, (f, m, x, y) in enumerate(rows_of(tracks))
    ]


def wide(tracks, name="{axis}{marker}", time="Frame"):
    """One row a frame."""
    markers = range(tracks.shape[1])
    header = [time, *(name.format(axis=axis, marker=m) for m in markers for axis in "xy")]
    return [header] + [
        [str(frame), *(shown(v) for v in points.ravel())] for frame, points in enumerate(tracks)
    ]


def positions(tracks):
    """A row for each position, with markers counted from 7."""
    return [["Frame", " Marker", " x", " y"]] + [
        [str(f), str(m + 7), shown(x), shown(y)] for f, m, x, y in rows_of(tracks)
    ]


FORMATS = {
    "DeepLabCut": deeplabcut,
    "SLEAP": sleap,
    "TrackMate": trackmate,
    "trackpy": trackpy,
    "a picture": wide,
    "any program": positions,
}


def write(path: Path, rows, separator=",", encoding="utf-8"):
    text = "\n".join(separator.join(row) for row in rows) + "\n"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("program", FORMATS)
@pytest.mark.parametrize("tracks", [TRACKS, LOST], ids=["all seen", "some lost"])
def test_a_table_is_recognised_by_its_columns(tmp_path, program, tracks):
    read = read_tracks(write(tmp_path / "tracks.csv", FORMATS[program](tracks)))
    np.testing.assert_array_equal(read.positions, tracks)
    assert "downwards" in read.summary[0]
    assert program in read.summary[0] or program == "any program"


@given(
    program=st.sampled_from([name for name in FORMATS if name != "DeepLabCut"]),
    separator=st.sampled_from(SEPARATORS),
    encoding=st.sampled_from(ENCODINGS),
)
def test_separators_and_encodings_change_nothing(tmp_path_factory, program, separator, encoding):
    path = tmp_path_factory.mktemp("tracks") / "tracks.csv"
    read = read_tracks(write(path, FORMATS[program](LOST), separator, encoding))
    np.testing.assert_array_equal(read.positions, LOST)


@pytest.mark.parametrize(
    "name", ["{axis}{marker}", "{axis}_{marker}", "m{marker}.{axis}", "m{marker} {axis}"]
)
def test_wide_tables_name_their_columns_in_several_ways(tmp_path, name):
    read = read_tracks(write(tmp_path / "tracks.csv", wide(TRACKS, name, "time [s]")))
    np.testing.assert_array_equal(read.positions, TRACKS)


def test_deeplabcut_may_track_several_individuals(tmp_path):
    read = read_tracks(write(tmp_path / "tracks.csv", deeplabcut(LOST, levels=4)))
    np.testing.assert_array_equal(read.positions, LOST)


def test_unsure_positions_are_left_out_and_counted(tmp_path):
    path = write(tmp_path / "tracks.csv", deeplabcut(LOST, confidence=0.3))
    with refused("6 frames", "least_confidence"):
        read_tracks(path)
    np.testing.assert_array_equal(read_tracks(path, least_confidence=0.2).positions, LOST)
    rows = deeplabcut(TRACKS)
    rows[4][3] = "0.1"  # of marker 0 in frame 1
    read = read_tracks(write(path, rows))
    assert np.isnan(read.positions[1, 0]).all()
    assert "1 positions of a confidence below 0.6 are left out" in read.summary


def test_an_array_of_tracking_markers_counts_y_upwards(tmp_path):
    np.save(tmp_path / "tracks.npy", TRACKS)
    up = read_tracks(tmp_path / "tracks.npy")
    np.testing.assert_array_equal(up.positions, TRACKS * [1, -1])
    np.testing.assert_array_equal(read_tracks(tmp_path / "tracks.npy", "down").positions, TRACKS)
    assert "upwards, as tracking-markers writes it" in up.summary[0]


def test_the_file_that_tracking_markers_wrote_of_a_video_is_read_upright():
    """A video of four squares: the two lower move down by 3 pixels a frame (see the script)."""
    read = read_tracks(Path(__file__).with_name("tracked_by_tracking_markers.npy"))
    moved = read.positions[-1] - read.positions[0]
    rows = np.argsort(read.positions[0, :, 1])
    lower, upper = rows[2:], rows[:2]
    np.testing.assert_allclose(moved[upper], 0, atol=0.5)
    np.testing.assert_allclose(moved[lower], [[0, 27], [0, 27]], atol=1)


def test_zeros_are_lost_markers(tmp_path):
    tracks = TRACKS.copy()
    tracks[3:, 2] = 0
    read = read_tracks(write(tmp_path / "tracks.csv", wide(tracks)))
    assert np.isnan(read.positions[3:, 2]).all()
    assert "3 positions at (0, 0) are left out" in read.summary


def test_positions_without_two_numbers_are_lost_markers(tmp_path):
    tracks = TRACKS.copy()
    tracks[2, 0, 1], tracks[3, 4, 0] = NAN, np.inf
    np.save(tmp_path / "tracks.npy", tracks)
    read = read_tracks(tmp_path / "tracks.npy", "down")
    assert np.argwhere(np.isnan(read.positions[..., 0])).tolist() == [[2, 0], [3, 4]]
    assert "2 positions without a number are left out" in read.summary


def timed(tracks):
    """A wide table with the times of a camera of 4 Hz."""
    header, *rows = wide(tracks, time="time [ms]")
    return [header, *([str(250 * number), *row[1:]] for number, row in enumerate(rows))]


@given(
    program=st.sampled_from([*FORMATS, "times"]),
    lost=st.sets(st.integers(1, 11), min_size=1, max_size=10),
    empty=st.booleans(),
)
def test_a_frame_that_shows_nothing_is_lost_at_its_own_number(
    tmp_path_factory, program, lost, empty
):
    """Whether it has no row, or a row without positions."""
    tracks = np.round(np.random.default_rng(4).uniform(50, 900, (13, 4, 2)), 2)
    kept = np.setdiff1d(np.arange(13), [*lost])
    if empty:
        tracks[[*lost]] = NAN
    rows = timed(tracks) if program == "times" else FORMATS[program](tracks)
    if not empty:
        column = {"trackpy": -2, "TrackMate": -1, "SLEAP": 1}.get(program, 0)
        names = [str(250 * each if program == "times" else each) for each in lost]
        begin = next(number for number, row in enumerate(rows) if row[column] == "0")
        below = [row for row in rows[begin:] if row[column] not in names]
        rows = [row for row in rows[:begin] if row[column] not in names] + below
    path = write(tmp_path_factory.mktemp("tracks") / "tracks.csv", rows)
    read = read_tracks(path, frame_rate=4.0)
    np.testing.assert_array_equal(read.frames, kept)
    np.testing.assert_array_equal(read.positions, tracks[kept])
    assert f"{len(lost)} of 13 frames show no marker" in read.summary


def test_frames_may_be_counted_from_1_or_any_number(tmp_path):
    rows = positions(TRACKS)
    for first in (1, 30):
        moved = [rows[0], *([str(int(row[0]) + first), *row[1:]] for row in rows[1:])]
        path = write(tmp_path / "tracks.csv", moved)
        np.testing.assert_array_equal(read_tracks(path, first_frame=first).frames, range(6))
        np.testing.assert_array_equal(read_tracks(path, first_frame=0).frames, first + np.arange(6))
    with refused("frame 30", "first_frame"):
        read_tracks(path)


def test_times_that_contradict_the_frame_rate_are_refused(tmp_path):
    with refused("250 s", "frame_rate"):
        rows = swapped(timed(TRACKS), 0, 0, "time")
        read_tracks(write(tmp_path / "tracks.csv", rows), frame_rate=4.0)


def test_lengths_of_trackmate_need_the_unit_as_the_pixel(tmp_path):
    path = write(tmp_path / "tracks.csv", trackmate(TRACKS, "mm"))
    np.testing.assert_array_equal(read_tracks(path, pixel=1.0).positions, TRACKS)
    with refused("in mm", "pixel = "):
        read_tracks(path, pixel=0.05)


def swapped(rows, row, column, text):
    changed = [list(each) for each in rows]
    changed[row][column] = text
    return changed


POSITIONS, POINTS = trackpy(TRACKS), deeplabcut(TRACKS)


@pytest.mark.parametrize(
    ("rows", "part"),
    [
        (swapped(POSITIONS, 3, -1, "u"), "'u'"),
        ([*POSITIONS[:4], *POSITIONS[3:]], "twice in frame"),
        ([*sleap(TRACKS), sleap(TRACKS)[-1]], "twice in frame"),
        (swapped(POSITIONS, 0, -1, "id"), "columns of markers"),
        ([*POINTS[:2], *POINTS[3:]], "coords"),
        (swapped(POINTS, 3, 2, "left"), "export it again"),
        ([*POINTS[:2], ["coords", *["x", "y", "z"] * 5], *POINTS[3:]], "x, y, likelihood"),
    ],
)
def test_a_damaged_table_is_refused(tmp_path, rows, part):
    with refused(part):
        read_tracks(write(tmp_path / "tracks.csv", rows))


@pytest.mark.parametrize("shape", ["(-5, 6, 2)", f"({10**30}, 6, 2)"])
def test_a_damaged_header_of_an_array_is_refused(tmp_path, shape):
    path = tmp_path / "tracks.npy"
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    path.write_bytes((b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little")) + text + bytes(480))
    with refused("numpy.save"):
        read_tracks(path)
