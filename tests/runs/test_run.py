"""Real small sweeps: files that are written or reused, and reports of failures."""

import json
import os
import subprocess

import numpy as np
import pytest
import xarray as xr

from knitlab.cubes.case_file import case_path
from knitlab.io import provenance
from knitlab.io.errors import InputError
from knitlab.observables.schema import COORDINATES, VARIABLES
from knitlab.observables.status import Status
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions

SMALL = ("strain_max=0.1", "strain_step=0.05", "n_subunit=8,12,16")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    results = tmp_path_factory.mktemp("sweep")
    plan = make_plan("periodic", ("n_stripe=4,8", *SMALL))
    return plan, results, run_plan(plan, results, RunOptions())


def test_invalid_numbers_are_refused_with_the_name_of_their_argument():
    with pytest.raises(InputError) as caught:
        RunOptions(workers=-1, retries=-2, case_timeout=0)
    named = [entry.path for entry in caught.value.mistakes]
    assert named == ["workers -1", "retries -2", "case_timeout 0"]
    for seconds in (float("inf"), float("nan"), 1e300):
        with pytest.raises(InputError, match=r"case_timeout.*1,000,000 s"):
            RunOptions(case_timeout=seconds)


def test_a_single_batch_needs_no_worker_unless_one_is_asked_for():
    automatic = RunOptions(workers=None)
    assert automatic.processors(1) == 0
    assert automatic.processors(2) == (os.cpu_count() or 1)
    assert RunOptions(workers=None, case_timeout=60).processors(1) > 0  # to be ended
    assert [RunOptions(workers=number).processors(1) for number in (0, 1, 3)] == [0, 1, 3]


@pytest.mark.slow
@pytest.mark.nightly
def test_the_cube_on_disk_is_the_one_that_was_built(sweep):
    _, results, run = sweep
    with xr.open_dataset(results / "cube.nc") as cube:
        xr.testing.assert_identical(cube.load(), run.cube.assign_attrs(cube.attrs))


def test_every_variable_carries_units_and_a_long_name(sweep):
    _, results, run = sweep
    case = xr.load_dataset(next((results / "cases").glob("*.nc")))
    for dataset in (run.cube, case):
        for name in dataset.variables:
            assert dataset[name].attrs["units"] == (COORDINATES | VARIABLES)[name].units
            assert dataset[name].attrs["long_name"]
    kinds = ("all", "patches", "design", "stripes", "cloth", "robustness", "contact")
    expected = {
        name for name, each in VARIABLES.items() if each.in_cube and each.group.name in kinds
    }
    assert expected == set(run.cube.data_vars)


def test_impossible_designs_are_excluded_and_the_others_are_ok(sweep):
    plan, _, run = sweep
    status = run.cube["status"]
    assert status.sel(n_stripe=4, n_subunit=12) == Status.excluded
    assert (status == Status.ok).sum() == len(plan.cases) == 3
    assert run.failures == ()
    values = run.cube["poisson_ratio_min"].where(status == Status.excluded, drop=True)
    assert values.isnull().all()


def test_results_are_converged_and_report_their_residual(sweep):
    _, _, run = sweep
    ok = run.cube["status"] == Status.ok
    assert float(run.cube["residual_force"].max()) <= 1e-8
    assert (run.cube["iterations"].where(ok, 1) > 0).all()
    assert run.cube["applied_strain"].values.tolist() == [0, 0.05, 0.1]
    assert float(np.abs(run.cube["mean_strain_yy"] - run.cube["applied_strain"]).max()) < 1e-9


def test_provenance_states_how_to_repeat_the_run(sweep):
    plan, results, run = sweep
    for name in ("source", "git_commit", "library_versions", "random_seeds", "workflow"):
        assert run.cube.attrs[name]
    shared = json.loads(run.cube.attrs["parameters"])
    assert shared.pop("stripes") == plan.stripes
    for case_id, case in plan.cases.items():
        record = json.loads(json.dumps(case.record))
        assert {name: record[name] for name in shared} == shared
        with xr.open_dataset(case_path(results, case_id)) as dataset:
            assert json.loads(dataset.attrs["parameters"]) == record
    assert shared["sheet"]["z_max"] == 6.0
    assert run.cube.attrs["model_cell_size"] == "relaxed"


def never(results, cases, progress):
    raise AssertionError("nothing is missing")


def test_a_second_run_recomputes_nothing(sweep):
    plan, results, run = sweep
    before = {path: path.stat().st_mtime_ns for path in (results / "cases").iterdir()}
    again = run_plan(plan, results, RunOptions(simulate=never))
    assert again.simulated == ()
    assert again.failures == ()
    assert {path: path.stat().st_mtime_ns for path in (results / "cases").iterdir()} == before
    xr.testing.assert_identical(again.cube, run.cube)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_workers_give_the_results_of_this_process(sweep, tmp_path, workers):
    plan, _, run = sweep
    spawned = run_plan(plan, tmp_path, RunOptions(workers=workers)).cube
    assert (spawned["status"] == run.cube["status"]).all()
    for name in ("mean_strain_xx", "reaction_force", "energy_fold"):
        np.testing.assert_allclose(spawned[name], run.cube[name], rtol=1e-6, atol=1e-9)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_clamped_sample_of_one_cell_has_no_poisson_ratio(tmp_path):
    sample = ("boundary=clamped", "start=flat", "unit_cells=[[1,1],[2,1]]")
    overrides = ("n_stripe=4", "n_subunit=8", *SMALL[:2], *sample)
    cube = run_plan(make_plan("periodic", overrides), tmp_path, RunOptions()).cube.squeeze()
    assert (cube["status"] == Status.ok).all()
    one, two = (cube.sel(unit_cells=label) for label in ("1x1", "2x1"))
    assert one["poisson_ratio"].isnull().all()
    assert one["strain_xx"].isnull().all()
    assert one["poisson_ratio_min"].isnull()
    assert one["mean_strain_yy"].notnull().all()
    assert two["poisson_ratio"][1:].notnull().all()


@pytest.mark.slow
def test_a_design_that_does_not_converge_is_reported_not_averaged(tmp_path):
    plan = make_plan("periodic", ("n_stripe=4", *SMALL, "max_iterations=2", "ramp_steps=1"))
    run = run_plan(plan, tmp_path, RunOptions())
    status = run.cube["status"].sel(n_stripe=4, n_subunit=[8, 16])
    assert (status == Status.not_converged).all()
    assert run.cube["poisson_ratio_min"].isnull().all()
    assert float(run.cube["residual_force"].max()) > 1e-8
    lines = [json.loads(line) for line in (tmp_path / "failures.jsonl").read_text().splitlines()]
    assert lines == json.loads(json.dumps(run.failures))
    assert len(lines) == 2
    assert "no equilibrium at applied strain 0" in lines[0]["reason"]


def test_a_clone_of_another_owner_has_no_commit_and_says_why(monkeypatch):
    def run(command, **settings):
        raise subprocess.CalledProcessError(
            128, command, stderr="fatal: detected dubious ownership in repository at '/code'"
        )

    monkeypatch.setattr(provenance.subprocess, "run", run)
    stated = provenance.git_commit()
    assert stated.startswith("unknown")
    assert "safe.directory" in stated
