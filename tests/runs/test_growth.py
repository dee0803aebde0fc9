"""Cubes that grow, swept settings, and stale results, by a fake simulator."""

import itertools
import json
import os

import numpy as np
import pytest
import xarray as xr

from knitlab.cubes.cube_file import read_cube
from knitlab.io.errors import InputError
from knitlab.io.shipped import shipped
from knitlab.observables.status import Status
from knitlab.runs import results_folder
from knitlab.runs.plan import make_plan
from knitlab.runs.recorded_plan import changed_inputs, read_plan
from knitlab.runs.results_folder import CaseState
from knitlab.runs.status import folder_status, status
from knitlab.solvers.case import case_of
from tests.refusals import refused
from tests.runs import fake_simulator
from tests.runs.fake_simulator import ran

PAIRS = ("n_stripe=4", "n_subunit=16,24", "strain_max=0.06")


def planned(*overrides):
    return make_plan("periodic", overrides)


def bits(cube, **labels):
    return {
        name: array.sel(labels).values.tobytes()
        for name, array in cube.data_vars.items()
        if name not in ("case_id", "code")
    }


@pytest.mark.slow
def test_new_designs_are_added_to_a_cube_whose_values_stay_bitwise_equal(tmp_path):
    first = ran(planned(*PAIRS), tmp_path)
    more = ran(planned("n_stripe=6,8", "n_subunit=24,48", "strain_max=0.06"), tmp_path)
    assert more.cube["n_stripe"].values.tolist() == [4, 6, 8]
    assert more.cube["n_subunit"].values.tolist() == [16, 24, 48]
    for n_subunit in (16, 24):
        labels = {"n_stripe": 4, "n_subunit": n_subunit}
        assert bits(more.cube, **labels) == bits(first.cube, **labels)
    assert more.cube["status"].sel(n_stripe=6, n_subunit=16) == Status.excluded
    assert more.cube["status"].sel(n_stripe=6, n_subunit=48) == Status.ok
    # Existing designs come first, and the cube does not depend on the order of the runs.
    again = ran(planned(*PAIRS), tmp_path)
    assert again.simulated == ()
    xr.testing.assert_identical(again.cube.drop_attrs(), more.cube.drop_attrs())


def test_a_folder_holds_one_grid_of_strains(tmp_path):
    folder = tmp_path / "results" / "periodic"
    before = ran(planned(*PAIRS), folder).cube
    finer = ("n_stripe=4", "strain_max=0.06", "strain_step=0.02")
    for designs in ("n_subunit=32", "n_subunit=16,24,32"):
        with refused(str(folder), "strains", f"{tmp_path / 'results'}-2"):
            ran(planned(designs, *finer), folder)
    with refused("strains"):  # those of n_subunit 24 would stay
        ran(planned("n_subunit=16", *finer), folder, refresh=True)
    xr.testing.assert_equal(read_cube(folder), before)
    stale = ran(planned("n_subunit=16", *finer), folder)
    assert "refresh" in stale.remarks(("n_stripe", "n_subunit"), folder)[-1]
    refreshed = ran(planned("n_subunit=16,24", *finer), folder, refresh=True).cube
    assert refreshed["applied_strain"].values.tolist() == [0, 0.02, 0.04, 0.06]


def test_status_takes_the_folder_of_a_workflow_too(tmp_path):
    ran(planned(*PAIRS), tmp_path / "periodic")
    of_folder = status(tmp_path / "periodic")
    assert of_folder.statuses == status("periodic", results=tmp_path).statuses


def test_a_longer_test_of_new_designs_lengthens_the_cube(tmp_path):
    first = ran(planned(*PAIRS), tmp_path)
    longer = ran(planned("n_stripe=8", "n_subunit=32", "strain_max=0.12"), tmp_path).cube
    assert longer["applied_strain"].values.tolist() == [0, 0.03, 0.06, 0.09, 0.12]
    old = longer["reaction_force"].sel(n_stripe=4, n_subunit=16)
    np.testing.assert_array_equal(
        old[:3], first.cube["reaction_force"].sel(n_stripe=4, n_subunit=16)
    )
    assert np.isnan(old[3:]).all()


@pytest.mark.slow
def test_settings_given_as_lists_are_dimensions_with_units(tmp_path):
    plan = planned(
        *PAIRS,
        "rib_k_t=0.01,0.02",
        "z_max_factor=0.5,1",
        "boundary=clamped,periodic",
        "unit_cells=[[1,1],[2,1]]",
        "ramp_steps=10,20",
    )
    swept = ("boundary", "ramp_steps", "rib_k_t", "unit_cells", "z_max_factor")
    assert plan.dims == ("n_stripe", "n_subunit", *swept)
    seen = [
        (each.options.boundary, each.weft.k_t, each.unit_cells, each.sheet.z_max)
        for each in plan.cases.values()
    ]
    values = (("clamped", "periodic"), (0.01, 0.02), ((1, 1), (2, 1)), (3.0, 6.0))
    assert {case.solver.ramp_steps for case in plan.cases.values()} == {10, 20}
    assert sorted(seen) == sorted(4 * [*itertools.product(*values)])
    cube = ran(plan, tmp_path).cube
    assert cube["rib_k_t"].attrs["units"] == "N"
    assert cube["z_max_factor"].attrs["units"] == "1"
    assert cube["unit_cells"].values.tolist() == ["1x1", "2x1"]
    assert cube.sizes["cell_y"] == 2
    one = {name: 0 for name in swept if name != "unit_cells"}
    wide = cube["strain_xx"].sel(n_stripe=4, n_subunit=16).isel(one)
    assert np.isnan(wide.sel(unit_cells="1x1", cell_y=1)).all()
    assert np.isfinite(wide.sel(unit_cells="2x1", cell_y=1)).all()


def test_factors_multiply_values_and_both_knits():
    design = ("n_stripe=4", "n_subunit=16")
    (plain,) = planned(*design).cases.values()
    settings = ("k_s_factor=2", "rib_k_s_factor=3", "garter_k_s=1.5", "z_max_factor=0.5")
    (case,) = planned(*design, *settings).cases.values()
    assert case.weft.k_s == pytest.approx(6 * plain.weft.k_s)
    assert case.warp.k_s == pytest.approx(3.0)
    assert case.weft.k_t == plain.weft.k_t
    assert case.sheet.z_max == pytest.approx(plain.sheet.z_max / 2)
    assert planned(*design, "k_s_factor=1").cases == planned(*design).cases


def test_a_cube_of_other_dimensions_is_not_mixed_in(tmp_path):
    ran(planned(*PAIRS), tmp_path)
    with pytest.raises(InputError, match="n_subunit, z_max"):
        ran(planned(*PAIRS, "z_max=4,6"), tmp_path)


@pytest.mark.slow
def test_results_of_other_parameters_stay_until_refreshed(tmp_path):
    first = ran(planned(*PAIRS), tmp_path)
    other = planned(*PAIRS, "z_max=4")
    kept = ran(other, tmp_path)
    assert kept.simulated == ()
    assert sorted(kept.left_in(CaseState.stale_parameters)) == sorted(other.cases)
    xr.testing.assert_identical(kept.cube.drop_attrs(), first.cube.drop_attrs())
    words = folder_status(tmp_path, other.dims, other.designs, check=True).statuses
    assert set(words.values()) == {CaseState.stale_parameters.value}
    fresh = ran(other, tmp_path, refresh=True)
    assert sorted(fresh.simulated) == sorted(other.cases)
    assert not fresh.left_in(CaseState.stale_parameters)
    assert set(fresh.cube["case_id"].values.ravel()) == set(other.cases)
    back = ran(planned(*PAIRS), tmp_path)
    assert back.simulated == (), "what was computed is not lost"
    xr.testing.assert_identical(back.cube.drop_attrs(), first.cube.drop_attrs())


def test_a_cube_states_only_what_holds_for_all_of_it(tmp_path):
    ran(planned(*PAIRS), tmp_path)
    joined = ran(planned("n_stripe=6", "n_subunit=24", "strain_max=0.12"), tmp_path).cube
    stated = json.loads(joined.attrs["parameters"])
    assert "applied_strain" not in stated
    assert (stated["sheet"]["z_max"], stated["sheet"]["k_wall"]) == (6.0, 100.0)
    stale = ran(planned("n_stripe=4,6", "n_subunit=16,24", "z_max=4"), tmp_path)
    assert "sheet.z_max was 6.0, is 4.0" in stale.changed
    assert json.loads(stale.cube.attrs["parameters"]) == stated


@pytest.mark.slow
@pytest.mark.parametrize("change", ["z_max=4", "cell_size=flat", "k_t_factor=2"])
def test_designs_of_another_model_do_not_join_a_cube(tmp_path, change):
    before = ran(planned(*PAIRS), tmp_path).cube
    with pytest.raises(InputError, match="2 designs"):
        ran(planned("n_stripe=8", "n_subunit=32", "strain_max=0.06", change), tmp_path)
    one = planned("n_stripe=4", "n_subunit=16", "strain_max=0.06", change)
    with pytest.raises(InputError, match="1 designs"):
        ran(one, tmp_path, refresh=True)
    xr.testing.assert_equal(read_cube(tmp_path), before)


def test_results_of_other_code_are_reported_and_recomputed_on_request(tmp_path, monkeypatch):
    plan = planned(*PAIRS)
    ran(plan, tmp_path)
    monkeypatch.setattr(results_folder, "MODEL", "model 0")
    kept = ran(plan, tmp_path)
    assert kept.simulated == ()
    assert sorted(kept.left_in(CaseState.stale_code)) == sorted(plan.cases)
    words = folder_status(tmp_path, plan.dims, plan.designs, check=False).statuses
    assert set(words.values()) == {CaseState.stale_code.value}
    assert sorted(ran(plan, tmp_path, refresh=True).simulated) == sorted(plan.cases)


def test_a_case_is_read_back_from_its_record():
    methods = (("periodic", "equilibrium"), ("periodic", "dynamics"), ("stripes", "equilibrium"))
    for workflow, method in methods:
        for case_id, case in make_plan(workflow, (f"method={method}",)).cases.items():
            again = case_of(json.loads(json.dumps(case.record)))
            assert again == case
            assert again.case_id == case_id


def test_a_plan_reports_which_of_its_files_have_changed(tmp_path):
    workflow = tmp_path / "mine.toml"
    workflow.write_text((shipped("workflows") / "preview.toml").read_text())
    plan = make_plan(str(workflow), PAIRS)
    plan.write(tmp_path / "plan.json")
    assert changed_inputs(read_plan(tmp_path)) == ()
    workflow.write_text(workflow.read_text() + "\n# a remark\n")
    assert changed_inputs(read_plan(tmp_path)) == (str(workflow),)


def test_the_status_of_a_folder_before_its_first_cube(tmp_path):
    plan = planned(*PAIRS)
    plan.write(tmp_path / "plan.json")
    fake_simulator.simulate(tmp_path, list(plan.cases.values())[:1], lambda *_: None)
    counts = folder_status(tmp_path, plan.dims, plan.designs, check=True).counts
    assert counts == {"done, not yet in the cube": 1, "pending": 1}
    os.truncate(next((tmp_path / "cases").glob("*.nc")), 100)
    counts = folder_status(tmp_path, plan.dims, plan.designs, check=True).counts
    assert counts == {"damaged": 1, "pending": 1}
