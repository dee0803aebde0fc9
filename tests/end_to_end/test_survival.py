"""A real sweep that is killed, resumed, damaged and reproduced by commands."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.commands import knitlab
from tests.file_events import kill_command

DESIGNS = ("--set", "n_stripe=4,8", "--set", "n_subunit=8,16", "--set", "strain_max=0.06")


def killed(folder, after):
    """A run in another process, killed before it writes one more case."""
    kill_command(folder, ["run", "periodic", *DESIGNS, "--workers", "0"], after + 1)
    return len(list((folder / "results" / "periodic" / "cases").glob("*.nc")))


@pytest.mark.slow
@pytest.mark.nightly
def test_a_killed_sweep_resumes_to_the_same_cube(tmp_path, in_folder):
    done = killed(tmp_path, after=1)
    assert done == 1
    result = knitlab("status", "periodic")
    assert f"{done} done, not yet in the cube" in result.output

    went_on = knitlab("run", "periodic", *DESIGNS, "--workers", "0")
    assert went_on.exit_code == 0, went_on.output
    assert f"{3 - done} cases simulated, {done} already there" in went_on.output
    knitlab("run", "periodic", *DESIGNS, "--workers", "0", "--results", "whole")
    cubes = [xr.load_dataset(f"{folder}/periodic/cube.nc") for folder in ("results", "whole")]
    assert set(cubes[0].data_vars) == set(cubes[1].data_vars)
    for name in ("status", "case_id", "code"):
        assert (cubes[0][name] == cubes[1][name]).all()
    for name in ("mean_strain_xx", "reaction_force", "energy_fold", "relaxed_cell_x"):
        np.testing.assert_allclose(cubes[0][name], cubes[1][name], rtol=1e-6, atol=1e-9)

    status = knitlab("status", "periodic", "--json")
    assert json.loads(status.output)["counts"] == {"ok": 3}

    case = next(Path("results/periodic/cases").glob("4-8-*.nc"))
    case.write_bytes(case.read_bytes()[:-100])
    assert "1 damaged" in knitlab("status", "periodic", "--check").output
    repaired = knitlab("run", "periodic", *DESIGNS, "--workers", "0")
    assert f"damaged: {case}" in repaired.output
    assert "1 cases simulated, 2 already there" in repaired.output

    other = knitlab("run", "periodic", *DESIGNS, "--set", "z_max=4", "--workers", "0")
    assert other.exit_code == 1
    assert "3 cases are kept as computed with other parameters" in other.output
    assert "3 stale: other parameters" in knitlab("status", "periodic").output


@pytest.mark.slow
def test_a_case_that_failed_is_reproduced_alone(tmp_path, in_folder):
    hasty = ("--set", "n_stripe=4", "--set", "n_subunit=8", "--set", "max_iterations=2")
    ran = knitlab("run", "periodic", *hasty, "--workers", "0")
    assert ran.exit_code == 1
    (failure,) = map(json.loads, Path("results/periodic/failures.jsonl").read_text().splitlines())
    alone = knitlab("reproduce", failure["case_id"])
    assert alone.exit_code == 1
    assert "iteration_limit" in alone.output
    assert failure["reason"] in alone.output
    result = knitlab("status", "periodic")
    assert failure["case_id"] in result.output
    assert failure["reason"] in result.output

    nobody = knitlab("reproduce", "4-8-000000000000")
    assert nobody.exit_code == 2
    assert "is in no plan.json" in nobody.output
