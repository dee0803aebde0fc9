"""What a case file or a cube records of its settings is a case, or a sentence."""

import json
import shutil

import pytest
import xarray as xr

from knitlab.cubes.case_file import read_case
from knitlab.cubes.cube_file import cells_across, open_cube, write_cube
from knitlab.cubes.recorded_case import recorded_case
from knitlab.io.errors import InputError
from knitlab.io.shipped import PACKAGE

REFERENCE = PACKAGE.parent / "results/reference/periodic"
BROKEN = ["", "[1]", "[" * 100_000, '{"design": {}}', '{"unit_cells": 3}', '{"sheet": [1]}']


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


@pytest.mark.parametrize("text", ["nonsense", '{"unit_cells": 3}', '{"sheet": {"z_max": "high"}}'])
def test_a_cube_with_broken_parameters_is_refused_by_its_name(folder, text):
    cube = xr.load_dataset(folder / "cube.nc")
    write_cube(cube.assign_attrs(parameters=text), folder / "cube.nc")
    with pytest.raises(InputError, match=f"^{folder.name}: parameters: "):
        open_cube(folder)


def test_an_experiment_without_a_number_of_unit_cells_is_refused(folder):
    cube = open_cube(folder)
    recorded = json.loads(cube.attrs["parameters"])
    assert cells_across(cube) == recorded.pop("unit_cells")[1]
    with pytest.raises(InputError, match="unit_cells"):
        cells_across(cube.assign_attrs(parameters=json.dumps(recorded)))
