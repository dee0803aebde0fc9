"""Single designs in Python: the results of a sweep, without a workflow."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import knitlab as kl
from knitlab.io.shipped import shipped
from knitlab.study.parameters import read_parameters

STRAINS = [0.0, 0.03, 0.06]
SMALL = kl.Design(n_stripe=4, n_subunit=8, boundary="periodic")
FLAT = {"cell_size": "flat", "z_max": 1.9}
"""The model options of the workflow of periodic fabric."""


@pytest.fixture(scope="module")
def small_test():
    return kl.simulate(SMALL, STRAINS, **FLAT)


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    folder = tmp_path_factory.mktemp("api")
    settings = {"n_stripe": 4, "n_subunit": 8, "strain_max": 0.06}
    return kl.run("periodic", results=folder, robustness=0, k_t_factor=[1.0, 1.2], **settings)


def test_a_test_is_what_a_sweep_computes(small_test, cube):
    swept = cube.sel(n_stripe=4, n_subunit=8, k_t_factor=1.0)
    assert small_test["position"].dims[0] == "applied_strain"
    for name in set(cube.data_vars) - {"case_id", "code", "status"}:
        np.testing.assert_allclose(
            small_test[name].values, swept[name].values, rtol=1e-6, atol=1e-9, err_msg=name
        )


def test_settings_and_own_stripes_are_two_ways_to_one_fabric(cube):
    stripes = read_parameters(shipped("params")).stripes
    stiffer = {
        knit: replace(each, k_t=1.2 * each.k_t)
        for knit, each in (
            ("rib", stripes.stripe("rib", 4)),
            ("garter", stripes.stripe("garter", 8)),
        )
    }
    by_stripes = kl.simulate(replace(SMALL, **stiffer), STRAINS, **FLAT)
    by_setting = kl.simulate(SMALL, STRAINS, k_t_factor=1.2, **FLAT)
    swept = cube.sel(n_stripe=4, n_subunit=8, k_t_factor=1.2)
    for test in (by_stripes, by_setting):
        np.testing.assert_allclose(test["poisson_ratio"], swept["poisson_ratio"], rtol=1e-6)


def test_a_stripe_that_no_table_has_makes_a_design():
    rib = kl.Stripe("rib", 5, period=1.6, k_s=0.8, theta_0=0.9, k_t=0.012)
    garter = kl.Stripe("garter", 10, period=1.5, k_s=0.7, theta_0=1.0, k_t=0.011)
    design = kl.Design(n_stripe=5, n_subunit=10, boundary="periodic", rib=rib, garter=garter)
    test = kl.simulate(design, [0, 0.03])
    assert test["status"] == 1
    assert test["rib_k_t"] == rib.k_t


def test_a_test_that_does_not_converge_is_reported_and_its_values_are_missing():
    with pytest.warns(kl.NotConverged, match="n_stripe 4 .* no equilibrium at applied strain 0"):
        test = kl.simulate(SMALL, STRAINS, max_iterations=2)
    assert test["poisson_ratio"].isnull().all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n_subunit": 10}, "not a positive multiple of 2 × n_stripe"),
        ({"n_stripe": 7, "n_subunit": 14}, "n_stripe = 7 has no rib stripe"),
        ({"pattern": ("RG", "R")}, "pattern"),
        ({"unit_cells": (1, 1), "needles": 90}, "both unit_cells and needles"),
    ],
)
def test_an_impossible_design_is_refused(change, message):
    with pytest.raises(kl.BadInput, match=message):
        kl.simulate(replace(SMALL, **change), STRAINS)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"k_tfactor": 2}, "did you mean 'k_t_factor'"),
        ({"k_t_factor": [1, 2]}, "takes one value"),
        ({"k_t_factor": -1}, "k_t_factor = -1: .* greater than 0"),
        ({"n_stripe": 4}, "belongs to the design"),
        ({"strain_max": 0.3}, "leave it out"),
    ],
)
def test_an_invalid_setting_is_refused(settings, message):
    with pytest.raises(kl.BadInput, match=message):
        kl.simulate(SMALL, STRAINS, **settings)


@pytest.mark.parametrize("strains", [[], [0.03, 0.06], [0, 0.06, 0.03], [0, 0.03, 0.03]])
def test_strains_ascend_from_zero(strains):
    with pytest.raises(kl.BadInput, match="applied_strain"):
        kl.simulate(SMALL, strains)


def test_a_stripe_must_have_the_knit_of_its_argument():
    rib = kl.Stripe("rib", 4, period=1.6, k_s=0.8, theta_0=3.5, k_t=0.012)
    with pytest.raises(kl.BadInput, match=r"garter: is a rib stripe.*\n?.*theta_0"):
        kl.Design(n_stripe=4, n_subunit=16, garter=rib)


def test_figures_show_a_test_and_a_cube(small_test, cube):
    assert "pulled 3%" in kl.plot.shape(small_test, applied_strain=0.03).axes[0].get_title()
    assert kl.plot.curves(small_test).axes
    assert kl.plot.shape(cube, k_t_factor=1.2).axes
    with pytest.raises(kl.BadInput, match="applied_strain"):
        kl.plot.shape(small_test, n_stripe=4)


def test_a_case_file_holds_what_simulate_returns(small_test, tmp_path):
    small_test.to_netcdf(tmp_path / "test.nc")
    with xr.open_dataset(tmp_path / "test.nc") as again:
        np.testing.assert_array_equal(again["position"], small_test["position"])
