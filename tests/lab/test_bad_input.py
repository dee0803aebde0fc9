"""Bad descriptions and records are refused: the message names the place, and nothing is written."""

import pickle

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from tests.cubes.artificial_cubes import synthetic_cube
from tests.lab.recorded import Laboratory


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    laboratory = Laboratory(tmp_path_factory.mktemp("good"))
    laboratory.write()
    return laboratory


def imported(tmp_path, good, kind, changes=(), files=()):
    """Message and result of an import, with parts of the description and of files changed."""
    description = good.description()
    for path, value in changes:
        *tables, key = path.split(".")
        table = description
        for name in tables:
            table = table[name]
        if value is None:
            del table[key]
        else:
            table[key] = value
    for name in ("markers.npy", "tensile.csv", "meter.csv"):
        (tmp_path / name).write_bytes((good.folder / name).read_bytes())
    for name, change in files:
        change(tmp_path / name)
    path = tmp_path / "sheet.toml"
    path.write_text(tomli_w.dumps(description))
    results = tmp_path / "results"
    return CliRunner().invoke(main, ["import", kind, str(path), "--results", str(results)]), results


def refused(tmp_path, good, kind, *parts, changes=(), files=()):
    result, results = imported(tmp_path, good, kind, changes, files)
    assert result.exit_code == 2, result.output
    for part in parts:
        assert part in result.output
    assert "Traceback" not in result.output
    assert not results.exists() or not list(results.rglob("*"))
    return result


def lines(change):
    def rewrite(path):
        path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")

    return rewrite


def cell(row, column, value):
    def change(text):
        fields = text[row].split(",")
        fields[column] = value
        return [*text[:row], ",".join(fields), *text[row + 1 :]]

    return lines(change)


def negated(column):
    def change(text):
        rows = [line.split(",") for line in text[1:]]
        for row in rows:
            row[column] = str(-float(row[column]))
        return [text[0], *(",".join(row) for row in rows)]

    return lines(change)


def array(change):
    def rewrite(path):
        np.save(path, change(np.load(path)))

    return rewrite


def with_value(value, *place):
    def change(tracks):
        tracks = tracks.copy()
        tracks[place] = value
        return tracks

    return array(change)


TENSILE = {
    "empty": (lambda path: path.write_text(""), "table"),
    "short row": (lines(lambda text: [*text[:5], "0.01", *text[6:]]), "line 6"),
    "words": (cell(7, 1, "slack"), "point 7 is 'slack'"),
    "a NaN": (cell(7, 3, "nan"), "column force: point 7 is 'nan'"),
    "time back": (lines(lambda text: [*text, *text[1:]]), "goes back from 64 s to 0 s"),
    "no column": (lines(lambda text: [text[0].replace("force", "F"), *text[1:]]), "column force"),
    "twice": (lines(lambda text: [text[0].replace("trigger", "force"), *text[1:]]), "force"),
    "never pulled": (lines(lambda text: text[:30]), "column extension"),
    "pulled less": (lines(lambda text: text[:200]), "strain_max is 0.3"),
    "negative force": (negated(3), "column force"),
    "negative extension": (negated(1), "column extension"),
    "gone": (lambda path: path.unlink(), "check the path"),
}


@pytest.mark.parametrize("name", TENSILE)
def test_a_bad_tensile_log_is_refused(tmp_path, good, name):
    change, part = TENSILE[name]
    refused(tmp_path, good, "tensile", "tensile.csv", part, files=[("tensile.csv", change)])


MARKERS = {
    "pickled": (lambda path: np.save(path, np.array([{}, 1], object)), "pickled"),
    "plain pickle": (lambda path: path.write_bytes(pickle.dumps([1])), "numpy.save"),
    "cut off": (lambda path: path.write_bytes(path.read_bytes()[:2000]), "not a complete"),
    "flat": (array(np.ravel), "(frames, markers, 2)"),
    "three dimensions": (array(lambda tracks: np.repeat(tracks, 2, 2)), "(frames, markers, 2)"),
    "no frames": (array(lambda tracks: tracks[:0]), "(0, "),
    "words": (array(lambda tracks: tracks.astype(str)), "numbers"),
    "blind": (with_value(np.nan, slice(None)), "shows no marker"),
    "blind at the start": (with_value(np.nan, slice(24)), "frame 24, at a strain of 0.008"),
    "one marker": (array(lambda tracks: tracks[:, :1]), "1 markers"),
    "a line": (array(lambda tracks: tracks[:, :4]), "one line"),
    "no grid": (array(lambda tracks: tracks**3), "a table of their places"),
    "still": (array(lambda tracks: np.repeat(tracks[:1], len(tracks), axis=0)), "do not move"),
    "all frames late": (array(lambda tracks: tracks[:3]), "correct starts or frame_rate"),
}


@pytest.mark.parametrize("name", MARKERS)
def test_bad_markers_are_refused(tmp_path, good, name):
    change, part = MARKERS[name]
    refused(tmp_path, good, "markers", "markers.npy", part, files=[("markers.npy", change)])


ROWS = "frame,marker,x,y\n" + "".join(
    f"{frame},{marker},{10 * (marker % 3)},{10 * (marker // 3) + frame}\n"
    for frame in range(3)
    for marker in range(9)
)


@pytest.mark.parametrize(
    ("table", "text", "part"),
    [
        ("file", ROWS.replace("marker,", "point,", 1), "no columns of markers"),
        ("file", ROWS.replace("\n0,4,", "\n0,4.5,"), "4.5 at point 5"),
        ("file", ROWS.replace("\n0,", "\n3,").replace("\n1,", "\n4,"), "first_frame = 2"),
        ("file", ROWS + "2,8,1,1\n", "twice in frame 2"),
        ("places", "marker,row,column\n0,0,0\n99,0,1\n", "marker 99"),
        ("places", "marker,row,column\n0,0,0\n1,0,0\n", "markers 0 and 1"),
        ("places", "marker,row\n0,0\n", "column column"),
        ("places", "marker,row,column\n0,0,0\n", "0 × 0 unit cells"),
    ],
)
def test_a_bad_table_of_markers_or_places_is_refused(tmp_path, good, table, text, part):
    def write(path):
        path.with_name("other.csv").write_text(text)

    changes = [(f"markers.{table}", "other.csv")]
    refused(tmp_path, good, "markers", part, changes=changes, files=[("markers.npy", write)])


PER_FRAME = [("markers.frame_rate", None), ("markers.strain_per_frame", 0.01)]
SIDEWAYS = [
    ("markers.weft", "down"),
    ("markers.warp", "right"),
    ("sample.unit_cells", [4, 4]),
    ("sample.width.value", 80.0),
    ("sample.length.value", 6.0),
]


@pytest.mark.parametrize(
    ("kind", "changes", "part"),
    [
        ("tensile", [("tensile.force.unit", None)], "tensile.force.unit"),
        ("tensile", [("tensile.force.unit", "mm")], "is in mm"),
        ("tensile", [("tensile.time.unit", "wurble")], "'wurble'"),
        ("tensile", [("tensile.extension.column", "stretch")], "time, extension"),
        ("tensile", [("tensile.extension.unit", "um")], "column extension"),
        ("tensile", [("sample.length.unit", "s")], "sample.length: is in s"),
        ("tensile", [("sample.length.value", -3.0)], "is -3"),
        ("tensile", [("sample.n_subunit", 15)], "15"),
        ("tensile", [("protocol.strain_step", 0.07)], "strain_step = 0.07"),
        ("tensile", [("protocol.strain_max", 0.4)], "strain_max is 0.4"),
        ("tensile", [("protocol.skip_cycles", 1)], "after 1 cycles"),
        ("tensile", [("tensile.colour", "red")], "tensile.colour"),
        ("tensile", [("tensile", None)], "tensile"),
        ("tensile", [("source", "simulation")], "source = simulation"),
        ("markers", [("markers.pixel", None)], "markers.pixel"),
        ("markers", [("markers.pixel.unit", "N")], "is in N"),
        ("markers", [("markers.weft", "sideways")], "markers.weft"),
        ("markers", [("markers.weft", "up")], "parallel"),
        ("markers", [("markers.frame_rate", None)], "frame_rate"),
        ("markers", [("markers.starts", None)], "needs starts"),
        ("markers", [("markers.relaxed_frames", 10**6)], "relaxed_frames 1000000"),
        ("markers", [("markers.file", "markers.avi")], ".npy or .csv"),
        ("markers", [("sample.unit_cells", [2, 2])], "4 × 3 unit cells of a sample of 2 × 2"),
        # The clock is 30 s off: the fabric is strained where the machine does not pull.
        ("markers", [("markers.starts.value", -20.0)], "correct starts"),
        ("markers", [("markers.relaxed_frames", 60)], "relaxed_frames 60"),
        ("markers", [("markers.pixel.value", 1000.0)], "sample.width: is 45 mm for 3 unit cells"),
        ("markers", [("sample.length.value", 30.0)], "sample.length: is 300 mm for 4 unit cells"),
        ("markers", [("markers.markers_per_cell", [2, 1])], "sample.length: is 80 mm"),
        ("markers", SIDEWAYS, "90° off"),
        ("markers", [("markers.turned", 40.0)], "turned"),
        ("markers", PER_FRAME, "has starts"),
        ("capacitance", [("capacitance.starts", None)], "trigger"),
        ("capacitance", [("capacitance.trigger", {"column": "TRIG"})], "either starts"),
        ("capacitance", [("capacitance.starts.value", 1e6)], "the machine's clock"),
        ("capacitance", [("capacitance.capacitance.unit", "pH")], "is in pH"),
    ],
)
def test_a_wrong_description_is_refused(tmp_path, good, kind, changes, part):
    refused(tmp_path, good, kind, part, changes=changes)


def test_all_mistakes_are_in_one_message(tmp_path, good):
    changes = [
        ("tensile.force.unit", "mm"),
        ("sample.width", None),
        ("markers.pixel.value", 0.0),
        ("title", None),
    ]
    places = [f"{name}: " for name in ("tensile.force", "sample.width", "markers.pixel", "title")]
    refused(tmp_path, good, "markers", *places, changes=changes)
    files = [("tensile.csv", cell(7, 3, "x")), ("tensile.csv", cell(8, 1, "y"))]
    refused(tmp_path, good, "tensile", "point 7 is 'x'", "point 8 is 'y'", files=files)


def test_a_bad_log_of_a_meter_is_refused(tmp_path, good):
    triggers = [
        ("capacitance.starts", None),
        ("capacitance.trigger", {"column": "TRIG"}),
        ("tensile.trigger", {"column": "trigger"}),
    ]
    flat = lines(lambda text: [text[0], *(row.rsplit(",", 1)[0] + ",0" for row in text[1:])])
    for part, changes, change in (
        ("column TRIG", triggers, flat),
        ("-5 pF", (), negated(1)),
    ):
        refused(tmp_path, good, "capacitance", part, changes=changes, files=[("meter.csv", change)])


def test_a_cube_of_simulations_is_not_overwritten(tmp_path, good):
    (tmp_path / "results" / "sheet").mkdir(parents=True)
    path = tmp_path / "results" / "sheet" / "cube.nc"
    synthetic_cube().to_netcdf(path)
    before = path.read_bytes()
    result, _ = imported(tmp_path, good, "tensile")
    assert result.exit_code == 2
    assert "holds simulations" in result.output
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "changes",
    [
        [("protocol.strain_step", 0.1)],
        [("sample.length.value", 8.5), ("protocol.strain_max", 0.25)],
        [("sample.unit_cells", [4, 4]), ("protocol.strain_max", 0.25)],
    ],
)
def test_records_of_another_sample_are_not_mixed_in(tmp_path, good, changes):
    assert imported(tmp_path, good, "tensile")[0].exit_code == 0
    before = (tmp_path / "results" / "sheet" / "cube.nc").read_bytes()
    result, results = imported(tmp_path, good, "markers", changes)
    assert result.exit_code == 2
    assert "import all records again" in result.output
    assert (results / "sheet" / "cube.nc").read_bytes() == before


def test_the_old_names_of_prior_std_are_accepted(tmp_path):
    empty = tmp_path / "empty.nc"
    empty.touch()
    with pytest.warns(DeprecationWarning, match="prior_std"), pytest.raises(kl.InputError):
        kl.fit("nowhere.nc", "laboratory", looseness=0.1)
    result = CliRunner().invoke(main, ["fit", str(empty), "laboratory", "--looseness", "0.1"])
    assert result.exit_code == 2
    assert "--prior-std" in result.output


def test_settings_beside_a_plan_are_refused():
    with pytest.raises(kl.InputError, match="settings"):
        kl.fit("nowhere.nc", kl.plan("laboratory"), strain_max=0.1)
