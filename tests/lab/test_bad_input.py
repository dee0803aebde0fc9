import pickle

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.io.errors import InputError
from tests.cubes.artificial_cubes import made_up_cube
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
    result = CliRunner().invoke(main, ["import", kind, str(path), "--results", str(results)])
    return result, results


def refused(tmp_path, good, kind, *problems, changes=(), files=()):
    result, results = imported(tmp_path, good, kind, changes, files)
    assert result.exit_code == 2, result.output
    for problem in problems:
        assert problem in result.output
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


TENSILE = [
    ("empty", lambda path: path.write_text(""), "has no table of numbers"),
    ("header only", lines(lambda text: text[:1]), "has no table of numbers"),
    ("ragged", lines(lambda text: [*text[:5], text[5] + ",1,2,3", *text[6:]]), "line 6: has"),
    ("short row", lines(lambda text: [*text[:5], "0.01", *text[6:]]), "line 6: has 1 fields"),
    ("words", cell(7, 1, "slack"), "point 7 is 'slack'"),
    ("a NaN", cell(7, 3, "nan"), "column force: point 7 is 'nan'"),
    ("a run of NaN", lambda path: [cell(row, 3, "NaN")(path) for row in range(9, 20)], "10 more"),
    ("infinite", cell(7, 3, "inf"), "not a finite number"),
    ("time back", cell(9, 0, "0.001"), "does not rise"),
    ("time again", lines(lambda text: [*text[:9], text[8], *text[9:]]), "does not rise"),
    ("no column", lines(lambda text: [text[0].replace("force", "Last"), *text[1:]]), "is missing"),
    (
        "twice",
        lines(lambda text: [text[0].replace("trigger", "force"), *text[1:]]),
        "occurs twice",
    ),
    ("never pulled", lines(lambda text: text[:30]), "never rises"),
    ("pulled less", lines(lambda text: text[:200]), "but strain_max is 0.3"),
    ("binary", lambda path: path.write_bytes(bytes(range(128, 255))), "is no text"),
    ("gone", lambda path: path.unlink(), "cannot be read"),
]


@pytest.mark.parametrize(
    ("change", "problem"), [row[1:] for row in TENSILE], ids=[r[0] for r in TENSILE]
)
def test_a_bad_tensile_log_is_refused(tmp_path, good, change, problem):
    refused(tmp_path, good, "tensile", "tensile.csv", problem, files=[("tensile.csv", change)])


MARKERS = [
    ("pickled", lambda path: np.save(path, np.array([{}, 1], object)), "pickled objects"),
    ("plain pickle", lambda path: path.write_bytes(pickle.dumps([1])), "is not an .npy array"),
    ("text", lambda path: path.write_text("frame,marker"), "numpy.save"),
    ("empty file", lambda path: path.write_bytes(b""), "is not an .npy array"),
    (
        "cut off",
        lambda path: path.write_bytes(path.read_bytes()[:2000]),
        "is not a complete .npy array",
    ),
    ("flat", array(np.ravel), "(frames, markers, 2)"),
    ("three dimensions", array(lambda tracks: np.repeat(tracks, 2, 2)), "(frames, markers, 2)"),
    ("no frames", array(lambda tracks: tracks[:0]), "is empty"),
    ("words", array(lambda tracks: tracks.astype(str)), "no array of numbers"),
    ("infinite", with_value(np.inf, 4, 3, 1), "is infinite for marker 3 in frame 4"),
    ("half a marker", with_value(np.nan, 4, 3, 1), "only one coordinate of marker 3 in frame 4"),
    ("blind frames", with_value(np.nan, slice(40, 60)), "shows no marker in 20 frames (40, 41"),
    ("one marker", array(lambda tracks: tracks[:, :1]), "1 markers are seen"),
    ("a line", array(lambda tracks: tracks[:, :4]), "in one line"),
    ("no grid", array(lambda tracks: tracks**3), "a table of their places"),
    ("all frames late", array(lambda tracks: tracks[:3]), "does not cover the first pull"),
]


@pytest.mark.parametrize(
    ("change", "problem"), [row[1:] for row in MARKERS], ids=[r[0] for r in MARKERS]
)
def test_bad_markers_are_refused(tmp_path, good, change, problem):
    refused(tmp_path, good, "markers", "markers.npy", problem, files=[("markers.npy", change)])


ROWS = "frame,marker,x,y\n" + "".join(
    f"{frame},{marker},{10 * (marker % 3)},{10 * (marker // 3) + frame}\n"
    for frame in range(3)
    for marker in range(9)
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "has no table of numbers"),
        ("frame,marker,x,y\n", "has no table of numbers"),
        (ROWS.replace("marker,", "point,", 1), "has no columns of markers"),
        (ROWS.replace("\n0,4,", "\n0,4.5,"), "has 4.5 at point 5"),
        (ROWS.replace("\n1,", "\n7,"), "skips 1"),
        (
            ROWS.replace("\n0,", "\n40,").replace("\n1,", "\n41,").replace("\n2,", "\n42,"),
            "frame 40",
        ),
        (ROWS + "2,8,1,1\n", "a marker twice in one frame"),
        (ROWS.replace("\n0,4,10,10", "\n0,4,ten,10"), "point 5 is 'ten'"),
    ],
)
def test_a_bad_table_of_markers_is_refused(tmp_path, good, text, problem):
    def write(path):
        path.with_suffix(".csv").write_text(text)

    changes = [("markers.file", "markers.csv")]
    refused(tmp_path, good, "markers", problem, changes=changes, files=[("markers.npy", write)])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("marker,row,column\n0,0,0\n99,0,1\n", "names marker 99, but there are 20"),
        ("marker,row,column\n0,0,0\n1,0,0\n", "markers 0 and 1 are both in row 0, column 0"),
        ("marker,row\n0,0\n", "column column: is missing"),
        ("marker,row,column\n0,0,0\n", "shows 0 × 0 unit cells"),
    ],
)
def test_a_bad_table_of_places_is_refused(tmp_path, good, text, problem):
    def write(path):
        path.with_name("places.csv").write_text(text)

    changes = [("markers.places", "places.csv")]
    refused(tmp_path, good, "markers", problem, changes=changes, files=[("markers.npy", write)])


DESCRIPTIONS = [
    ("tensile", "tensile.force.unit", None, "tensile.force.unit: is missing"),
    ("tensile", "tensile.force.unit", "mm", "is in mm; give it in a unit of force"),
    ("tensile", "tensile.time.unit", "wurble", "unknown unit 'wurble'"),
    ("tensile", "tensile.extension.column", "stretch", "the file has time, extension"),
    ("tensile", "sample.length.unit", "s", "sample.length: is in s"),
    ("tensile", "sample.length.value", -3.0, "is -3; give one above 0"),
    ("tensile", "sample.n_subunit", 15, "not a positive multiple"),
    ("tensile", "protocol.strain_step", 0.07, "is not a whole number"),
    ("tensile", "protocol.strain_max", 0.4, "but strain_max is 0.4"),
    ("tensile", "tensile.colour", "red", "not a known key"),
    ("tensile", "tensile", None, "tensile"),
    ("tensile", "source", "simulation", "is reserved for simulations"),
    ("markers", "markers.pixel", None, "markers.pixel: is missing"),
    ("markers", "markers.pixel.unit", "N", "is in N"),
    ("markers", "markers.weft", "sideways", "markers.weft"),
    ("markers", "markers.weft", "up", "are parallel"),
    ("markers", "markers.frame_rate", None, "frame_rate"),
    ("markers", "markers.starts", None, "needs starts"),
    ("markers", "markers.relaxed_frames", 10**6, "exceeds the number of frames"),
    ("markers", "markers.file", "markers.avi", "no suffix .npy or .csv"),
    ("markers", "markers.file", "none.npy", "cannot be read"),
    ("markers", "sample.unit_cells", [2, 2], "shows 4 × 3 unit cells of a sample of 2 × 2"),
    ("capacitance", "capacitance.starts", None, "or trigger"),
    ("capacitance", "capacitance.trigger", {"column": "TRIG"}, "needs either starts"),
    ("capacitance", "capacitance.starts.value", 1e6, "by the machine's clock"),
    ("capacitance", "capacitance.capacitance.unit", "pH", "is in pH"),
]


@pytest.mark.parametrize(("kind", "path", "value", "problem"), DESCRIPTIONS)
def test_a_bad_description_is_refused(tmp_path, good, kind, path, value, problem):
    refused(tmp_path, good, kind, problem, changes=[(path, value)])


def test_all_faults_are_in_one_message(tmp_path, good):
    changes = [
        ("tensile.force.unit", "mm"),
        ("sample.width", None),
        ("markers.pixel.value", 0.0),
        ("title", None),
    ]
    result = refused(tmp_path, good, "markers", changes=changes)
    for place in ("tensile.force", "sample.width", "markers.pixel", "title"):
        assert f"{place}: " in result.output


def test_a_log_lists_the_faults_of_all_its_columns(tmp_path, good):
    files = [("tensile.csv", cell(7, 3, "x")), ("tensile.csv", cell(8, 1, "y"))]
    refused(tmp_path, good, "tensile", "point 7 is 'x'", "point 8 is 'y'", files=files)


def test_a_trigger_that_never_rises_is_refused(tmp_path, good):
    changes = [
        ("capacitance.starts", None),
        ("capacitance.trigger", {"column": "TRIG"}),
        ("tensile.trigger", {"column": "trigger"}),
    ]
    flat = lines(lambda text: [text[0], *(row.rsplit(",", 1)[0] + ",0" for row in text[1:])])
    refused(
        tmp_path,
        good,
        "capacitance",
        "column TRIG: does not begin low and rise",
        changes=changes,
        files=[("meter.csv", flat)],
    )


def test_a_capacitance_below_zero_is_refused(tmp_path, good):
    files = [("meter.csv", cell(5, 1, "-3"))]
    refused(tmp_path, good, "capacitance", "a capacitance is above 0", files=files)


SIDEWAYS = [
    ("markers.weft", "down"),
    ("markers.warp", "right"),
    ("sample.unit_cells", [4, 4]),
    ("sample.width.value", 80.0),
    ("sample.length.value", 6.0),
]
CHANGES = [
    # The clock is 30 s off: the fabric is strained where the machine does not pull.
    ("markers", [("markers.starts.value", -20.0)], "correct starts"),
    ("markers", [("markers.relaxed_frames", 60)], "already reach a strain of"),
    ("markers", [("markers.pixel.value", 1000.0)], "sample.width: is 45 mm for 3 unit cells"),
    ("markers", [("sample.length.value", 30.0)], "sample.length: is 300 mm for 4 unit cells"),
    ("markers", [("markers.markers_per_cell", [2, 1])], "sample.length: is 80 mm"),
    ("markers", SIDEWAYS, "moves 90° off the separation of its rows"),
    ("markers", [("markers.turned", 40.0)], "correct them, or give turned"),
    ("markers", [("markers.frame_rate", None), ("markers.strain_per_frame", 0.01)], "has starts"),
    ("tensile", [("protocol.skip_cycles", 1)], "never rises after 1 cycles"),
    ("tensile", [("tensile.extension.unit", "um")], "check its unit and sign"),
]


@pytest.mark.parametrize(("kind", "changes", "problem"), CHANGES)
def test_a_description_that_the_records_contradict_is_refused(
    tmp_path, good, kind, changes, problem
):
    refused(tmp_path, good, kind, problem, changes=changes)


FALSE = [
    ("negative force", 3, lambda value: -value, "give tension as positive"),
    ("negative extension", 1, lambda value: -value, "reaches an applied strain of only"),
]


@pytest.mark.parametrize(("what", "column", "change", "problem"), FALSE)
def test_a_log_with_the_wrong_sign_is_refused(tmp_path, good, what, column, change, problem):
    def turned(text):
        rows = [line.split(",") for line in text[1:]]
        for row in rows:
            row[column] = str(change(float(row[column])))
        return [text[0], *(",".join(row) for row in rows)]

    files = [("tensile.csv", lines(turned))]
    result = refused(tmp_path, good, "tensile", files=files)
    assert problem in result.output or "never rises" in result.output


def test_still_markers_are_refused(tmp_path, good):
    still = array(lambda tracks: np.repeat(tracks[:1], len(tracks), axis=0))
    problem = "do not move while the sample is pulled"
    refused(tmp_path, good, "markers", problem, files=[("markers.npy", still)])


def test_a_log_with_semicolons_and_decimal_commas_is_the_same(tmp_path, good):
    (tmp_path / "other").mkdir()
    other = lines(lambda text: [line.replace(",", ";").replace(".", ",") for line in text])
    _, plain = imported(tmp_path, good, "tensile")
    _, same = imported(tmp_path / "other", good, "tensile", files=[("tensile.csv", other)])
    force, again = (
        kl.open_cube(results / "sheet").reaction_force.values for results in (plain, same)
    )
    np.testing.assert_array_equal(force, again)


def test_a_cube_of_simulations_is_not_overwritten(tmp_path, good):
    (tmp_path / "results" / "sheet").mkdir(parents=True)
    path = tmp_path / "results" / "sheet" / "cube.nc"
    made_up_cube().to_netcdf(path)
    before = path.read_bytes()
    result, _ = imported(tmp_path, good, "tensile")
    assert result.exit_code == 2
    assert "holds simulations" in result.output
    assert path.read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "value"), [("sample.length.value", 8.5), ("sample.unit_cells", [4, 4])]
)
def test_records_of_a_corrected_sample_are_not_mixed_with_old_ones(tmp_path, good, path, value):
    assert imported(tmp_path, good, "tensile")[0].exit_code == 0
    result, _ = imported(tmp_path, good, "markers", [(path, value), ("protocol.strain_max", 0.25)])
    assert result.exit_code == 2
    assert "remove it, and import all records again" in result.output


def test_a_refused_import_does_not_change_the_cube(tmp_path, good):
    result, results = imported(tmp_path, good, "tensile")
    assert result.exit_code == 0, result.output
    before = (results / "sheet" / "cube.nc").read_bytes()
    (tmp_path / "tensile.csv").write_text("")
    result = CliRunner().invoke(
        main, ["import", "tensile", str(tmp_path / "sheet.toml"), "--results", str(results)]
    )
    assert result.exit_code == 2
    assert (results / "sheet" / "cube.nc").read_bytes() == before


def test_records_of_another_sample_are_not_mixed_in(tmp_path, good):
    result, _ = imported(tmp_path, good, "tensile")
    assert result.exit_code == 0
    result, _ = imported(tmp_path, good, "markers", [("protocol.strain_step", 0.1)])
    assert result.exit_code == 2
    assert "has another sample, length, width, source, cycles or strains" in result.output


def test_settings_beside_a_plan_are_refused():
    plan = kl.plan("laboratory")
    with pytest.raises(InputError, match="settings: belong to workflows; plan the workflow with"):
        kl.fit("nowhere.nc", plan, strain_max=0.1)
