"""The gauge of a cube: sizes in cloth that follow it without a new simulation."""

import json

import numpy as np
import pytest
import xarray as xr

import knitlab
from knitlab.cubes.derived import with_derived
from knitlab.observables.knit_size import ALONG_X, ALONG_Y
from knitlab.runs.plan import make_plan
from knitlab.runs.results_folder import CaseState
from tests.runs import fake_simulator

SIZES = (*ALONG_X, *ALONG_Y)
DESIGN = ("n_stripe=4", "n_subunit=16,24", "strain_max=0.03", "strain_step=0.03")


def ran(results, *overrides, workflow="paper", simulate=fake_simulator.simulate):
    plan = make_plan(workflow, (*DESIGN, *overrides) if workflow == "paper" else overrides)
    return fake_simulator.ran(plan, results, simulate)


def never(results, cases, progress):
    raise AssertionError("nothing is missing")


def test_sizes_in_cloth_follow_contraction_and_stitches(tmp_path):
    cube = ran(tmp_path, "scale=0.3").cube.isel(n_stripe=0)
    for n_subunit, cells_y, cells_x in ((16, 6, 3), (24, 4, 2)):
        design = cube.sel(n_subunit=n_subunit)
        cell_x = design["relaxed_cell_x"] / design["flat_cell_x"] * 2 * n_subunit * 1.35
        cell_y = design["relaxed_cell_y"] / design["flat_cell_y"] * 4 * n_subunit * 0.8
        wave = design["wavelength_x"] / design["relaxed_cell_x"]
        np.testing.assert_allclose(design["knit_cell_x"], cell_x)
        np.testing.assert_allclose(design["knit_cell_y"], cell_y)
        np.testing.assert_allclose(design["knit_wavelength_x"], wave * cell_x)
        np.testing.assert_allclose(design["knit_width"], cells_x * cell_x)
        np.testing.assert_allclose(design["knit_length"], cells_y * cell_y)
    for name in SIZES:
        assert cube[name].attrs["units"] == "mm"
        assert "approximate" in cube[name].attrs["description"]


@pytest.mark.slow
def test_another_gauge_changes_sizes_in_cloth_alone_and_simulates_nothing(tmp_path):
    before = ran(tmp_path).cube
    run = ran(tmp_path, "stitch_width=2.7", simulate=never)
    assert run.simulated == ()
    assert not run.left_in(CaseState.stale_parameters)
    for name in ALONG_X:
        np.testing.assert_allclose(run.cube[name], 2 * before[name])
    xr.testing.assert_identical(
        run.cube.drop_vars(ALONG_X).drop_attrs(deep=False),
        before.drop_vars(ALONG_X).drop_attrs(deep=False),
    )
    back = ran(tmp_path, simulate=never).cube
    xr.testing.assert_allclose(back, before)
    assert back.attrs == before.attrs


@pytest.mark.slow
def test_a_cube_has_one_gauge_whenever_its_designs_were_run(tmp_path):
    ran(tmp_path / "turns", "n_subunit=16", "gauge.stitch_height=0.5")
    cube = ran(tmp_path / "turns", "n_subunit=24", "gauge.stitch_height=0.6").cube
    once = ran(tmp_path / "once", "stitch_height=0.6").cube
    xr.testing.assert_allclose(cube, once)
    for made in (cube, knitlab.open_cube(tmp_path / "turns")):
        assert made.attrs["gauge_stitch_height"] == 0.6
        assert made.attrs["gauge_stitch_width"] == 1.35


def test_a_plan_records_the_gauge_and_its_cases_do_not(tmp_path):
    plan, other = (make_plan("paper", (*DESIGN, *more)) for more in ((), ("stitch_width=2",)))
    assert plan.cases == other.cases
    other.write(tmp_path / "plan.json")
    frozen = json.loads((tmp_path / "plan.json").read_text())["gauge"]
    assert frozen == {"stitch_width": 2.0, "stitch_height": plan.gauge.stitch_height}


def test_periodic_fabric_has_cells_in_cloth_but_no_width_or_length(tmp_path):
    cube = ran(tmp_path, "boundary=clamped,periodic", "scale=0.3").cube
    for name in SIZES:
        assert np.isfinite(cube[name].sel(boundary="clamped")).all()
        missing = np.isnan(cube[name].sel(boundary="periodic")).all()
        assert missing == (name in ("knit_width", "knit_length"))


def test_pure_stripes_have_no_size_in_cloth(tmp_path):
    cube = ran(tmp_path, "n=2", "strain_max=0.03", "strain_step=0.03", workflow="stripes").cube
    assert not {*SIZES} & {*cube.data_vars}
    assert not [name for name in cube.attrs if name.startswith("gauge")]


def test_a_query_shows_sizes_in_cloth_as_the_first_millimetres(tmp_path):
    cube = with_derived(ran(tmp_path).cube)
    shown = [name for name in cube.knitlab.query() if cube[name].attrs.get("units") == "mm"]
    assert {*shown[: len(SIZES)]} == {*SIZES}
