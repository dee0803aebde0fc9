"""Single designs in Python: the results of a sweep, without a workflow."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import knitlab as kl
from knitlab.api.simulation import case_of_design
from knitlab.runs.workflow import Protocol

STRAINS = [0.0, 0.03, 0.06]
SMALL = kl.Design(4, 8, boundary="periodic")
DEFAULTS = kl.defaults()


@pytest.fixture(scope="module")
def small_test():
    return kl.simulate(SMALL, STRAINS)


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    folder = tmp_path_factory.mktemp("api")
    settings = {"n_stripe": 4, "n_subunit": 8, "strain_max": 0.06}
    return kl.run("periodic", results=folder, robustness=0, k_t_factor=[1.0, 1.2], **settings)


def test_a_test_is_what_a_sweep_computes(small_test, cube):
    swept = cube.sel(n_stripe=4, n_subunit=8, k_t_factor=1.0)
    assert small_test["position"].dims[0] == "applied_strain"
    # Waves and doubts are derived when a cube is opened.
    derived = {name for name in cube.data_vars if name.startswith(("waves_", "doubt_"))}
    for name in set(cube.data_vars) - {"case_id", "code", "status"} - derived:
        np.testing.assert_allclose(
            small_test[name].values, swept[name].values, rtol=1e-6, atol=1e-9, err_msg=name
        )


def test_own_stripes_and_factors_of_a_sweep_are_two_ways_to_one_fabric(cube):
    stripes = DEFAULTS.stripes
    stiffer = {
        knit: replace(each, k_t=1.2 * each.k_t)
        for knit, each in (
            ("rib", stripes.stripe("rib", 4)),
            ("garter", stripes.stripe("garter", 8)),
        )
    }
    test = kl.simulate(replace(SMALL, **stiffer), STRAINS)
    swept = cube.sel(n_stripe=4, n_subunit=8, k_t_factor=1.2)
    np.testing.assert_allclose(test["poisson_ratio"], swept["poisson_ratio"], rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "settings"),
    [
        ({}, {}),
        (
            {"model": kl.Model(contact="none"), "sheet": replace(DEFAULTS.sheet, z_max=1.9)},
            {"contact": "none", "z_max": 1.9},
        ),
        ({"sheet": replace(DEFAULTS.sheet, z_max=2)}, {"z_max": 2.0}),
        ({"solver": kl.Solver(tolerance=1e-9)}, {"tolerance": 1e-9}),
        ({"dynamics": kl.Dynamics(ending="time")}, {"ending": "time"}),
        (
            {"capacitor": replace(DEFAULTS.capacitor, layout=DEFAULTS.layouts["checkerboard"])},
            {"layout": "checkerboard"},
        ),
    ],
)
def test_objects_make_the_case_of_a_workflow_with_the_same_settings(given, settings, tmp_path):
    path = tmp_path / "one.toml"
    path.write_text('title = "one"\n[design]\nn_stripe = [4]\nn_subunit = [16]\n')
    (planned,) = kl.plan(path, **settings).cases
    parameters = DEFAULTS.with_tables(**given)
    design = kl.Design(4, 16)
    strains = Protocol().applied_strain
    case = case_of_design(design, strains, parameters, Protocol(), electrodes="capacitor" in given)
    assert case.case_id == planned


def test_stripes_of_other_sizes_replace_those_of_the_tables():
    pattern = kl.Pattern(rows=("GR", "RG"), column_stitches=(16, 24), column_n_stripe=(4, 6))
    own = replace(DEFAULTS.stripes.stripe("rib", 6), k_t=0.01)
    design = kl.Design(4, 16, pattern=pattern, further_stripes=(own,))
    case = case_of_design(design, [0], DEFAULTS, Protocol(), electrodes=False)
    assert [stripe.k_t for stripe in case.grading.weft] == [case.weft.k_t, 0.01]


def test_a_stripe_that_no_table_has_makes_a_design():
    rib = kl.Stripe("rib", 5, period=1.6, k_s=0.8, theta_0=0.9, k_t=0.012)
    garter = kl.Stripe("garter", 10, period=1.5, k_s=0.7, theta_0=1.0, k_t=0.011)
    design = kl.Design(n_stripe=5, n_subunit=10, boundary="periodic", rib=rib, garter=garter)
    test = kl.simulate(design, [0, 0.03])
    assert test["status"] == 1
    assert test["rib_k_t"] == rib.k_t


def test_a_test_that_does_not_converge_is_reported_and_its_values_are_missing():
    with pytest.warns(kl.NotConverged, match="n_stripe 4 .* no equilibrium at applied strain 0"):
        test = kl.simulate(SMALL, STRAINS, solver=kl.Solver(max_iterations=2))
    assert test["poisson_ratio"].isnull().all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"model": {"cell_size": "flat"}}, "model"),
        ({"solver": kl.Solver(drag=1e-6)}, "drag: .*boundary = clamped"),
        ({"solver": kl.Solver(tolerance=1e-3)}, "tolerance: .*0.001"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings, message):
    with pytest.raises(kl.InputError, match=message):
        kl.simulate(SMALL, STRAINS, **settings)
    with pytest.raises(kl.InputError, match=r"'4,16'.*knitlab\.Design"):
        kl.simulate("4,16")
    with pytest.raises(kl.InputError, match="n_stripe = 7"):
        kl.simulate(replace(SMALL, n_stripe=7, n_subunit=14), STRAINS)
    with pytest.raises(kl.InputError, match="boundary"):
        kl.simulate(kl.Design(4, 8), STRAINS, model=kl.Model(boundary="periodic"))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"robustness": 101}, "Protocol: robustness: .*100.*101"),
        ({"method": "dynamics", "unloading": True}, "unloading.*method = equilibrium"),
        ({"strain_max": 9.0, "strain_step": 0.006}, r"1\.5e\+03.*1000"),
        ({"strain_step": 0.04}, "strain_step = 0.04"),
        ({"strain_max": 45}, r"strain_max = 45.* 0\.45"),
    ],
)
def test_an_invalid_protocol_is_refused(settings, message):
    with pytest.raises(kl.InputError, match=message):
        kl.Protocol(**settings)


CALLS = """
import knitlab

design = knitlab.Design(8, 16)
knitlab.simulate(
    design,
    [0, 0.05],
    model=knitlab.Model(cell_size="flat"),
    sheet=knitlab.Sheet(z_max=1.9, k_wall=100.0),
    solver=knitlab.Solver(tolerance=1e-9),
    protocol=knitlab.Protocol(strain_max=0.3, robustness=1),
)
knitlab.simulate(design, model=knitlab.Model(cell_size="long"))
knitlab.simulate(design, k_t_factor=2)
"""


@pytest.mark.slow
def test_a_type_checker_accepts_right_settings_and_no_others(tmp_path):
    pytest.importorskip("mypy")
    (tmp_path / "calls.py").write_text(CALLS)
    ran = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "calls.py"],
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(Path(kl.__file__).parents[1])},
        capture_output=True,
        text=True,
    )
    errors = [line for line in ran.stdout.splitlines() if ": error: " in line]
    assert len(errors) == 2, ran.stdout + ran.stderr
    assert "incompatible type \"Literal['long']\"" in errors[0]
    assert 'Unexpected keyword argument "k_t_factor"' in errors[1]


@pytest.mark.parametrize("strains", [[], [0.03, 0.06], [0, 0.06, 0.03], [0, 0.03, 0.03]])
def test_strains_ascend_from_zero(strains):
    with pytest.raises(kl.InputError, match="applied_strain"):
        kl.simulate(SMALL, strains)


def test_a_stripe_must_have_the_knit_of_its_argument():
    rib = kl.Stripe("rib", 4, period=1.6, k_s=0.8, theta_0=1.5, k_t=0.012)
    with pytest.raises(kl.InputError, match="garter: is a rib stripe"):
        kl.Design(n_stripe=4, n_subunit=16, garter=rib)


def test_figures_show_a_test_and_a_cube(small_test, cube):
    assert "pulled 3%" in kl.plot.shape(small_test, applied_strain=0.03).axes[0].get_title()
    assert kl.plot.curves(small_test).axes
    assert kl.plot.shape(cube, k_t_factor=1.2).axes
    with pytest.raises(kl.InputError, match="applied_strain"):
        kl.plot.shape(small_test, n_stripe=4)


def test_a_case_file_holds_what_simulate_returns(small_test, tmp_path):
    small_test.to_netcdf(tmp_path / "test.nc")
    with xr.open_dataset(tmp_path / "test.nc") as again:
        np.testing.assert_array_equal(again["position"], small_test["position"])
