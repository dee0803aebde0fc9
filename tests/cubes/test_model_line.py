"""The line that states the model of a cube, made of its attributes and swept settings."""

import json

import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.cubes.cube_file import write_cube
from knitlab.cubes.model_line import model_line, model_lines
from knitlab.runs.plan import make_plan
from tests.cubes.artificial_cubes import synthetic_cube
from tests.runs import fake_simulator

BARRIER = {
    "method": "equilibrium",
    "model_cell_size": "flat",
    "model_contact": "barrier",
    "model_boundary": "periodic",
    "parameters": json.dumps({"sheet": {"thickness": 0.25}}),
}
SAMPLES = {"method": "dynamics", "model_cell_size": "relaxed", "model_boundary": "clamped"}


def with_samples(cube, counts):
    """The cube with samples of these unit cells, one for each n_subunit."""
    y, x = zip(*counts, strict=True)
    grid = {"n_subunit": cube["n_subunit"]}
    cells = {f"unit_cells_{axis}": xr.DataArray(list(n), grid) for axis, n in (("y", y), ("x", x))}
    return cube.assign({name: each + 0 * cube["status"] for name, each in cells.items()})


def test_contact_has_its_thickness():
    line = model_line(synthetic_cube().assign_attrs(BARRIER))
    assert line == "flat lengths, contact at 0.25 mm, periodic fabric, equilibrium"


def test_samples_have_their_sizes():
    cube = synthetic_cube().assign_attrs(SAMPLES)
    one = with_samples(cube, [(4, 3)] * 3)
    assert model_line(one) == "relaxed lengths, clamped samples of 4 × 3 unit cells, dynamics"
    assert "samples of 2 × 1 to 22 × 11 unit cells" in model_line(
        with_samples(cube, [(8, 4), (22, 11), (2, 1)])
    )


def test_a_swept_setting_has_all_its_values():
    plan = make_plan("sensor_contact", ("n_stripe=4", "n_subunit=16"))
    assert plan.common["sheet"]["thickness"] == 0.4
    swept = {"contact": ["none", "barrier"], "thickness": [0.1, 0.2]}
    cube = synthetic_cube().assign_coords(swept)
    assert model_line(cube) == "no contact and contact at 0.1, 0.2 mm"


def test_what_was_measured_has_no_model():
    assert "none, tester was measured" in model_line(
        synthetic_cube().assign_coords(source="tester")
    )
    assert model_line(synthetic_cube()) == "not stated in the cube"


def test_cubes_of_one_model_have_one_line():
    one, other = (synthetic_cube().assign_attrs(workflow=name) for name in ("one", "other"))
    assert model_lines([one, other]) == ["model: not stated in the cube"]
    lines = model_lines([one, other.assign_attrs(SAMPLES)])
    assert [line.partition(":")[0] for line in lines] == ["model of one", "model of other"]


@pytest.fixture
def folder(tmp_path):
    cube = synthetic_cube().assign_attrs(BARRIER)
    write_cube(cube, tmp_path / "cube.nc")
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        ["query", "CUBE", "--format", "csv"],
        ["query", "CUBE", "--format", "json"],
        ["find", "CUBE", "--target", "poisson_ratio_min = -0.5", "--format", "json"],
        ["map", "auxetic", "CUBE", "-o", "map.png"],
        ["explore", "CUBE", "-o", "page.html"],
    ],
)
def test_commands_print_the_line_beside_their_output(folder, words, monkeypatch):
    monkeypatch.chdir(folder)
    said = CliRunner().invoke(main, [str(folder) if word == "CUBE" else word for word in words])
    assert said.exit_code == 0, said.output
    line = kl.open_cube(folder).knitlab.model
    assert f"model: {line}" in said.stderr.splitlines()
    assert line not in said.stdout
    if words[0] == "explore":
        assert json.dumps(line, ensure_ascii=False) in (folder / "page.html").read_text("utf-8")


def test_the_line_of_a_run_is_that_of_its_workflow(tmp_path):
    fake_simulator.run_here(tmp_path, 0)
    line = kl.open_cube(tmp_path).knitlab.model
    assert line == "relaxed lengths, contact at 0.4 mm, periodic fabric, equilibrium"
