"""The content of a page: the numbers of the cube, the shapes of its case files, the report."""

import base64
import io
import shutil

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from knitlab.cubes.case_file import read_case
from knitlab.cubes.cube_file import open_cube
from knitlab.figures.explorer import shapes
from knitlab.figures.explorer.cube_content import (
    DAMAGED_CASE_FILE,
    MAX_FIGURES,
    NO_CASE_FILE,
    cube_content,
    figure_contents,
    variable_contents,
)
from knitlab.figures.explorer.shapes import shape_content
from knitlab.observables.status import Status
from tests.figures.explorer.conftest import HOSTILE, PREVIEW, REFERENCE
from tests.figures.explorer.test_positions import unpacked
from tests.refusals import refused


@pytest.fixture(scope="module")
def cube():
    return open_cube(PREVIEW)


@pytest.fixture(scope="module")
def content(cube):
    return cube_content(cube)


def test_values_are_those_of_the_cube(content, cube):
    variables = {each["name"]: each for each in content["variables"]}
    assert {"poisson_ratio", "reaction_force", "knit_cell_x", "periods"} <= set(variables)
    for name in ("poisson_ratio", "reaction_force"):
        shown = np.array(variables[name]["values"], float).reshape(10, -1)
        wanted = [cube[name].values[tuple(each["at"])] for each in content["designs"]]
        np.testing.assert_allclose(shown, wanted, rtol=5e-6, atol=1e-7 * np.nanmax(np.abs(wanted)))
        assert variables[name]["units"] == cube[name].attrs["units"]
    assert variables["poisson_ratio"]["values"][0] is None  # at zero strain


def test_bands_are_named(content):
    assert {each["name"]: each for each in content["variables"]}["poisson_ratio"]["band"] == {
        "low": "poisson_ratio_low",
        "high": "poisson_ratio_high",
    }


def test_what_has_no_number_for_a_design_or_a_state_is_left_out(content):
    assert not {"strain_xx", "boundary_x", "status", "case_id"} & {
        each["name"] for each in content["variables"]
    }


def test_a_sensitivity_is_a_variable_for_each_parameter(cube):
    given = cube[["status", "poisson_ratio"]].copy()
    parameters = xr.DataArray([1.0, 2.0], {"stripe_parameter": ["rib_k_t", "rib_k_s"]})
    given["poisson_ratio_sensitivity"] = given["poisson_ratio"] * parameters
    one, first, second = variable_contents(given, [(3, 5)])
    assert [first["name"], second["name"]] == [
        "poisson_ratio_sensitivity[rib_k_t]",
        "poisson_ratio_sensitivity[rib_k_s]",
    ]
    assert first["values"] == one["values"]
    np.testing.assert_allclose(second["values"][1:], 2 * np.array(one["values"][1:]), rtol=1e-5)


def test_a_shape_is_that_of_the_case_file(content):
    shown = {each["case_id"]: each["shape"] for each in content["designs"] if each["shape"]}
    assert len(shown) == 2
    for case_id, shape in shown.items():
        with xr.open_dataset(PREVIEW / "cases" / f"{case_id}.nc") as case:
            positions, periods = case["position"].values, case["length_x"].values
        design = open_cube(PREVIEW)
        design = design.where(design["case_id"] == case_id, drop=True).squeeze()
        area = float(design["knit_cell_x"] * design["knit_cell_y"])
        factor = np.sqrt(area / float(design["relaxed_cell_x"] * design["relaxed_cell_y"]))
        positions, periods = factor * positions, factor * periods
        assert shape["unit"] == "mm"
        assert shape["frames"] == list(range(len(positions)))
        found = unpacked(shape, positions.shape)
        assert (np.abs(found - positions).max(axis=(0, 1, 2)) <= shape["error"]).all()
        np.testing.assert_allclose(np.array(shape["periods"])[:, 0], periods)
        assert shape["knit"] == ["RG", "GR"]
        assert shape["row_borders"] == [0, shape["rows"] // 2, shape["rows"]]


def test_a_design_without_its_file_says_so(content):
    without = [each for each in content["designs"] if not each["shape"]]
    assert len(without) == 8
    assert {each["why_no_shape"] for each in without} == {NO_CASE_FILE}


def test_a_damaged_file_gives_no_shape(tmp_path):
    folder = tmp_path / "periodic"
    shutil.copytree(PREVIEW, folder)
    (damaged,) = (folder / "cases").glob("4-16-*.nc")
    damaged.write_bytes(damaged.read_bytes()[:1000])
    content = cube_content(open_cube(folder))
    reasons = {each["case_id"]: each["why_no_shape"] for each in content["designs"]}
    assert reasons[damaged.stem] == DAMAGED_CASE_FILE


def test_what_round_off_leaves_of_zero_is_zero(content):
    (force,) = (each for each in content["variables"] if each["name"] == "reaction_force")
    assert not np.array(force["values"]).reshape(10, -1)[:, 0].any()


def test_of_a_large_sample_the_central_unit_cells_are_shown(monkeypatch):
    monkeypatch.setattr(shapes, "MAX_NODES", 300)
    cube = open_cube(REFERENCE / "preview")
    case_id = cube["case_id"].sel(n_stripe=4, n_subunit=16).item()
    case, strains = read_case(REFERENCE / "preview", case_id), cube["applied_strain"].values
    shape = shape_content(case, strains)
    assert shape["rows"] * shape["columns"] == 17 * 17  # of one unit cell
    assert "1 × 1 of 3 × 2 unit cells" in shape["note"]
    positions = case["position"].values
    reached = np.isfinite(positions).all(axis=(1, 2, 3))
    np.testing.assert_allclose(strains[shape["frames"]], case["applied_strain"][reached])
    assert (np.array(shape["origin"])[:2] > np.nanmin(positions[..., :2], axis=(0, 1, 2))).all()


@pytest.mark.slow
def test_electrodes_are_placed_on_the_shape():
    cube = open_cube(REFERENCE / "sensor")
    case_id = cube["case_id"].sel(n_stripe=4, n_subunit=16).item()
    shape = shape_content(read_case(REFERENCE / "sensor", case_id), cube["applied_strain"].values)
    assert shape["electrodes"]["along"] in ("wale", "course")
    assert [len(strips) > 0 for strips in shape["electrodes"]["strips"]] == [True, True]


def test_the_report_says_what_ran_and_what_failed(troubled):
    content = cube_content(open_cube(troubled))
    facts = dict(content["run"]["facts"])
    assert facts["workflow"] == "periodic"
    assert facts["designs"] == "10: 7 ok, 1 not converged, 1 failed, 1 pending"
    assert facts["applied strains"] == "16, from 0 to 0.45"
    assert facts["computing time"].endswith("batches; known for 2 of 10 designs")
    (failed,) = (each for each in content["designs"] if each["status"] == Status.failed)
    assert failed["reason"] == HOSTILE
    assert dict(content["run"]["provenance"])["commit"]
    assert ["solver.tolerance", "1e-08"] in content["run"]["settings"]


def test_figures_are_reduced_for_the_screen(content):
    stored = {path.stem: path.stat().st_size for path in (PREVIEW / "figures").glob("*.png")}
    assert {each["name"] for each in content["figures"]["shown"]} == set(stored)
    for each in content["figures"]["shown"]:
        start, text = each["source"].split(",")
        drawn = base64.b64decode(text)
        with Image.open(io.BytesIO(drawn)) as image:
            assert start == f"data:image/{image.format.lower()};base64"
            assert image.width <= 1400 or image.format == "PNG"
        assert len(drawn) <= stored[each["name"]]


def test_figures_that_are_left_out_are_counted(tmp_path):
    (tmp_path / "figures").mkdir()
    for number in range(MAX_FIGURES + 3):
        Image.new("RGB", (4, 4)).save(tmp_path / "figures" / f"{number:02}.png")
    found = figure_contents(tmp_path)
    assert (len(found["shown"]), found["left_out"]) == (MAX_FIGURES, 3)


def test_a_damaged_figure_is_a_sentence(tmp_path):
    path = tmp_path / "figures" / "shape.png"
    path.parent.mkdir()
    Image.new("RGB", (40, 40)).save(path)
    contents = path.read_bytes()
    for damaged in (b"", contents[:50], contents.replace(b"IDAT", b"IDAU")):
        path.write_bytes(damaged)
        with refused("shape.png", "image"):
            figure_contents(tmp_path)
