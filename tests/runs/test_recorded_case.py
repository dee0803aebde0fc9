"""What a case file or a cube records of its settings is a case, or a sentence."""

import json
import shutil

import pytest
import xarray as xr
from click.testing import CliRunner

from knitlab.cli import main
from knitlab.cubes.case_file import read_case, write_case_file
from knitlab.cubes.cube_file import cells_across, open_cube, write_cube
from knitlab.cubes.recorded_case import recorded_case
from knitlab.io.errors import InputError
from knitlab.io.shipped import PACKAGE

REFERENCE = PACKAGE.parent / "results/reference/periodic"
BROKEN = [
    *("", "nonsense", "[1]", "3", "[" * 100_000),
    *(
        '{"design": {}}',
        '{"unit_cells": 3}',
        '{"sheet": [1]}',
        '{"unit_cells": [1, 1], "sheet": {}}',
    ),
]


@pytest.fixture(scope="module")
def case_id():
    return min((REFERENCE / "cases").glob("8-64-*.nc")).stem


@pytest.fixture
def folder(tmp_path, case_id):
    """A results folder with a cube, and with one case file."""
    (tmp_path / "cases").mkdir()
    for path in (REFERENCE / "cube.nc", *(REFERENCE / "cases").glob(f"{case_id}.*")):
        shutil.copy(path, tmp_path / path.relative_to(REFERENCE))
    return tmp_path


def test_a_case_is_that_of_its_identifier(folder, case_id):
    assert recorded_case(read_case(folder, case_id)).case_id == case_id


@pytest.mark.parametrize("text", [*BROKEN, 7.0, None])
def test_broken_parameters_of_a_case_are_one_sentence(folder, case_id, text):
    case_file = read_case(folder, case_id)
    case_file.attrs["parameters"] = text
    if text is None:
        del case_file.attrs["parameters"]
    with pytest.raises(InputError, match=rf"{case_id}.*run it.* again$") as said:
        recorded_case(case_file)
    assert len(said.value.mistakes) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [("map", "shape", ".", "-o", "shape.png"), ("export", ".", "-o", "shape.obj")]
)
def test_commands_refuse_a_case_with_broken_parameters(folder, case_id, words, monkeypatch):
    monkeypatch.chdir(folder)
    write_case_file(folder, case_id, read_case(folder, case_id).assign_attrs(parameters="[1]"))
    chosen = ("--select", "n_stripe=8", "--select", "n_subunit=64")
    said = CliRunner().invoke(main, [*words, *chosen])
    assert said.exit_code == 2, said.output
    assert "parameters: is not a table as knitlab writes it; run its workflow again" in said.output
    assert not list(folder.glob("shape*"))


@pytest.mark.parametrize("text", ["nonsense", '{"unit_cells": 3}', '{"sheet": {"z_max": "high"}}'])
def test_a_cube_with_broken_parameters_is_refused_by_its_name(folder, text):
    cube = xr.load_dataset(folder / "cube.nc")
    write_cube(cube.assign_attrs(parameters=text), folder / "cube.nc")
    with pytest.raises(InputError, match=f"^{folder.name}: parameters: is not a table"):
        open_cube(folder)


def test_an_experiment_without_a_number_of_unit_cells_is_refused(folder):
    cube = open_cube(folder)
    recorded = json.loads(cube.attrs["parameters"])
    assert cells_across(cube) == recorded.pop("unit_cells")[1]
    with pytest.raises(InputError, match="has no unit_cells in its parameters"):
        cells_across(cube.assign_attrs(parameters=json.dumps(recorded)))
