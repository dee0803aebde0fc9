"""The yarn of a material: kept by plans and cubes, and checked where it is given."""

import json

import pytest
import xarray as xr

import knitlab as kl
from knitlab.runs.material import add_stripe
from knitlab.runs.plan import joined_plan, make_plan
from knitlab.runs.yarn import YarnOnMachine

PAPER = kl.defaults()
STRIPES = PAPER.stripes.stripe("rib", 4), PAPER.stripes.stripe("garter", 8)
SETTINGS = {"n_stripe": 4, "n_subunit": 16}
MERINO = kl.Material(STRIPES, yarn="merino 2/30", stitch_size=9, machine="Kniterate")


def test_a_plan_and_its_file_keep_what_a_material_says_of_its_yarn(tmp_path):
    MERINO.write(tmp_path / "merino.toml")
    plan = make_plan("periodic", SETTINGS | {"material": str(tmp_path / "merino.toml")})
    assert plan.yarn == YarnOnMachine("merino 2/30", None, 9.0, None, "Kniterate")
    plan.write(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert joined_plan([record], "plan.json").yarn == plan.yarn
    assert make_plan("periodic", SETTINGS).yarn is None


@pytest.mark.parametrize("yarn", [MERINO.on_machine, YarnOnMachine(), YarnOnMachine(yarn="a")])
def test_a_cube_keeps_it_in_its_attributes(yarn, tmp_path):
    xr.Dataset(attrs=yarn.attributes).to_netcdf(tmp_path / "cube.nc")
    with xr.open_dataset(tmp_path / "cube.nc") as cube:
        read = YarnOnMachine.of_attributes(cube.attrs)
    assert read == yarn
    assert all(type(value) in (str, int, float) for value in read.given.values())


def test_calibrating_another_stripe_keeps_it(tmp_path):
    MERINO.write(tmp_path / "merino.toml")
    add_stripe(tmp_path / "merino.toml", PAPER.stripes.stripe("rib", 6), "swatch")
    read = kl.Material.read(tmp_path / "merino.toml")
    assert len(read.stripes) == 3
    assert read.on_machine == MERINO.on_machine
