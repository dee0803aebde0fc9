"""Sensitivities as variables of the cube, on request, against finite differences."""

from dataclasses import replace

import pytest
import xarray as xr

from knitlab.io.errors import InputError
from knitlab.model.fabric import Configuration
from knitlab.observables.schema import VARIABLES
from knitlab.observables.status import Status
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from knitlab.solvers.case import case_of
from knitlab.solvers.equilibrium.adjoint import LinearResponse, NoDerivative
from tests.runs import fake_simulator

SMALL = ("n_stripe=4", "n_subunit=8", "strain_max=0.06")
ASKED = ("sensitivities=true",)
NAMES = {name for name, each in VARIABLES.items() if each.group.name == "sensitivities"}


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    results = tmp_path_factory.mktemp("sensitivities")
    return run_plan(make_plan("periodic", (*SMALL, *ASKED)), results, RunOptions()).cube


@pytest.mark.slow
@pytest.mark.nightly
def test_sensitivities_are_in_the_cube_at_every_strain_but_zero(cube):
    assert {"poisson_ratio_sensitivity", "reaction_force_sensitivity"} == NAMES
    for name in NAMES:
        assert cube[name].dims[-2:] == ("applied_strain", "stripe_parameter")
        assert cube[name].sel(applied_strain=0).isnull().all()
        assert cube[name].sel(applied_strain=slice(0.01, None)).notnull().all()
    assert cube["poisson_ratio_sensitivity"].attrs["units"] == "1"
    assert cube["reaction_force_sensitivity"].attrs["units"] == "N"
    assert cube["stripe_parameter"].values.tolist() == [
        f"{knit}_{name}"
        for knit in ("rib", "garter")
        for name in ("k_s", "k_t", "theta_0", "period")
    ]


@pytest.mark.slow
def test_sensitivities_are_the_differences_of_results_with_other_parameters(cube, tmp_path):
    step = 1e-3
    factors = f"rib_theta_0_factor={1 - step},{1 + step}"
    other = run_plan(make_plan("periodic", (*SMALL, factors)), tmp_path, RunOptions()).cube
    for name in ("poisson_ratio", "reaction_force"):
        below, above = other[name].squeeze().isel(applied_strain=-1).values
        found = cube[f"{name}_sensitivity"].squeeze()
        found = found.sel(stripe_parameter="rib_theta_0").isel(applied_strain=-1)
        assert float(found) == pytest.approx((above - below) / (2 * step), rel=1e-4)


def test_a_cube_has_no_sensitivities_by_default(tmp_path):
    plain = run_plan(
        make_plan("periodic", SMALL), tmp_path, RunOptions(simulate=fake_simulator.simulate)
    )
    assert not NAMES & set(plain.cube.data_vars)
    assert "stripe_parameter" not in plain.cube.coords


def test_requesting_sensitivities_changes_the_case_and_is_read_back():
    (plain,), (asked,) = (
        make_plan("periodic", (*SMALL, *more)).cases.values() for more in ((), ASKED)
    )
    assert asked == replace(plain, sensitivities=True)
    assert asked.case_id != plain.case_id
    assert case_of(asked.record) == asked


@pytest.mark.slow
def test_designs_with_and_without_share_a_cube(tmp_path):
    options = RunOptions(simulate=fake_simulator.simulate)
    more = make_plan("periodic", ("n_stripe=6", "n_subunit=24", "strain_max=0.06", *ASKED))
    run_plan(make_plan("periodic", SMALL), tmp_path, options)
    first = run_plan(more, tmp_path, options).cube
    other = make_plan("periodic", ("n_stripe=8", "n_subunit=32", "strain_max=0.12"))
    cube = run_plan(other, tmp_path, options).cube
    assert (cube["status"] == Status.ok).sum() == 3
    found = cube["poisson_ratio_sensitivity"]
    assert found.sel(n_stripe=[4, 8]).isnull().all()
    xr.testing.assert_equal(
        found.sel(n_stripe=6, n_subunit=24, applied_strain=slice(0, 0.06)),
        first["poisson_ratio_sensitivity"].sel(n_stripe=6, n_subunit=24),
    )


@pytest.mark.slow
def test_undefined_sensitivities_are_missing(cube, monkeypatch, tmp_path):
    at = LinearResponse.at
    between = 1.045 * float(cube["relaxed_cell_y"].squeeze())

    def not_beyond(self, fabric, unknowns, contact):
        length_y = Configuration.of(unknowns, self.free.shape).lengths[1]
        if len(self.free.dofs) < len(unknowns) and length_y > between:
            raise NoDerivative
        return at(self, fabric, unknowns, contact)

    monkeypatch.setattr(LinearResponse, "at", not_beyond)
    cube = run_plan(make_plan("periodic", (*SMALL, *ASKED)), tmp_path, RunOptions()).cube
    found = cube["poisson_ratio_sensitivity"].squeeze().isnull().all("stripe_parameter")
    assert found.values.tolist() == [True, False, True]
    assert cube["status"] == Status.ok


@pytest.mark.parametrize(
    ("workflow", "message"),
    [
        ("relaxation", "dynamics gives no sensitivities"),
        ("stripes", "pure stripes have no sensitivities"),
    ],
)
def test_unavailable_sensitivities_are_refused(workflow, message):
    with pytest.raises(InputError, match=message):
        make_plan(workflow, ASKED)
