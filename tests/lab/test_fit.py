"""Fits to whole fabrics: perturbed parameters are recovered within their errors."""

from dataclasses import replace

import numpy as np
import pytest

from knitlab.io.toml import read_toml
from knitlab.lab.curves import (
    QUANTITIES,
    MeasuredTest,
    case_for,
    measured_test,
    simulated_test,
    with_factors,
)
from knitlab.lab.fit import FITTED, fit_stripes
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.observables.status import Status
from knitlab.runs.plan import make_plan
from knitlab.solvers.equilibrium.tensile_test import stretch
from tests.fabrics import equations
from tests.refusals import refused

STRAINS = (0.0, 0.03, 0.06, 0.12, 0.15, 0.18, 0.21)
TRUTH = {
    "rib_k_s": 0.8,
    "rib_k_t": 1.2,
    "rib_theta_0": 1.08,
    "garter_k_s": 1.2,
    "garter_k_t": 1.2,
    "garter_theta_0": 1.06,
}
PERIODIC = ("boundary=periodic", "unit_cells=1,1", "garter_start=valley", "start=dynamics")


def one_case(*overrides):
    (case,) = make_plan("laboratory", overrides).cases.values()
    return replace(case, capacitor=None, applied_strain=STRAINS)


@pytest.fixture(scope="module")
def case():
    return one_case(*PERIODIC)


@pytest.fixture(scope="module")
def truth(case):
    return simulated_test(with_factors(case, TRUTH))


def noisy(truth, relative, seed):
    errors = np.abs(truth.values).max(axis=1, keepdims=True) * relative * np.ones(len(STRAINS) - 1)
    noise = np.random.default_rng(seed).normal(0, 1, errors.shape) * errors
    return MeasuredTest(STRAINS[1:], truth.values + noise, errors)


@pytest.fixture(scope="module")
def fit(case, truth):
    return fit_stripes(case, noisy(truth, 0.005, seed=1), prior_std=0.2)


@pytest.mark.slow
@pytest.mark.nightly
def test_parameters_perturbed_by_20_percent_come_back_within_their_errors(fit):
    astray = [
        np.log(fit.factors[name] / TRUTH[name]) / fit.standard_errors[name] for name in FITTED
    ]
    assert np.abs(astray).max() < 3
    assert np.sqrt(np.mean(np.square(astray))) < 1.8
    # A hardly determined parameter would be recovered within its errors from any start.
    for name in ("rib_k_t", "rib_theta_0", "garter_k_t", "garter_theta_0"):
        assert fit.standard_errors[name] < 0.15
        assert fit.learned[name] > 0.5
    before, after = fit.chi_squared
    values = int(fit.target.measured.sum())
    assert before > 100 * values
    assert after < 2 * values
    assert fit.converged
    again = simulated_test(fit.after)
    np.testing.assert_allclose(again.values, fit.curves[1], rtol=1e-6, atol=1e-9)


@pytest.fixture(scope="module")
def short(case):
    """Below the strain of the snap, where the fabric has only one state, and precise."""
    fine = replace(case.equilibrium_solver, tolerance=1e-11)
    return replace(case, applied_strain=STRAINS[:3], solver=fine)


@pytest.fixture(scope="module")
def short_truth(short):
    return simulated_test(with_factors(short, TRUTH))


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("name", ["rib_k_t", "garter_theta_0", "garter_k_s"])
def test_derivatives_are_those_of_finite_differences(short, short_truth, name):
    truth, step = short_truth, 1e-4
    up, down = (
        simulated_test(with_factors(short, {**TRUTH, name: TRUTH[name] * np.exp(by)}), truth)
        for by in (step, -step)
    )
    expected = (up.values - down.values) / (2 * step)
    slopes = truth.slopes()[..., list(STRIPE_PARAMETERS).index(name)]
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes / scale.clip(1e-6), expected / scale.clip(1e-6), atol=1e-4)


@pytest.mark.slow
def test_a_test_continued_from_another_reaches_the_states_of_a_full_test(case):
    short = replace(case, applied_strain=STRAINS[:3])

    def near(rib_k_t):
        return simulated_test(short, simulated_test(with_factors(short, {"rib_k_t": rib_k_t})))

    # This fabric has two branches: with a softer rib it relaxes to its own, with a stiffer one to
    # the other, on which it stays.
    for one, other in ((near(0.99), simulated_test(short)), (near(1.03), near(1.01))):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-5, atol=1e-8)


@pytest.mark.slow
def test_without_data_the_fit_keeps_the_tables(case, truth):
    target = noisy(truth, 0.005, seed=1)
    fit = fit_stripes(case, replace(target, errors=target.errors * 1e6), prior_std=0.1)
    for name in FITTED:
        assert fit.factors[name] == pytest.approx(1.0, abs=1e-3)
        assert fit.standard_errors[name] == pytest.approx(0.1, rel=1e-3)
        assert fit.learned[name] < 0.01


@pytest.mark.slow
@pytest.mark.nightly
def test_a_poor_fit_warns(case, truth):
    target = noisy(truth, 0.005, seed=1)
    bent = MeasuredTest(
        STRAINS[1:3], target.values[:, :2] * [[1.6], [1.0], [0.5]], target.errors[:, :2]
    )
    short = replace(case, applied_strain=STRAINS[:3])
    said = " ".join(fit_stripes(short, bent, prior_std=0.05, starts=1).warnings)
    assert "times its errors" in said


@pytest.mark.slow
def test_a_sample_that_does_not_relax_is_refused(case, truth):
    hopeless = replace(case, solver=replace(case.equilibrium_solver, max_iterations=3))
    with refused("smaller strain_max"):
        fit_stripes(hopeless, noisy(truth, 0.005, 1), prior_std=0.2)


@pytest.mark.slow
@pytest.mark.nightly
def test_an_interrupted_fit_continues_with_its_tests(case, truth, tmp_path, monkeypatch):
    short = replace(case, applied_strain=STRAINS[:3])
    measured = noisy(truth, 0.005, seed=1)
    target = MeasuredTest(STRAINS[1:3], measured.values[:, :2], measured.errors[:, :2])
    simulated = []

    def counted(case, near):
        simulated.append(case.case_id)
        return simulated_test(case, near)

    monkeypatch.setattr("knitlab.lab.fit.simulated_test", counted)

    def interrupt(tests, _):
        if tests == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_stripes(short, target, 0.2, starts=1, step=interrupt, kept=tmp_path)
    assert len(simulated) == 3
    resumed = fit_stripes(short, target, 0.2, starts=1, kept=tmp_path)
    alone = fit_stripes(short, target, 0.2, starts=1)
    assert resumed.factors == pytest.approx(alone.factors, rel=1e-9)
    assert resumed.tests == alone.tests
    assert len(simulated) == 2 * alone.tests
    # A file that was cut off, emptied or changed is simulated again, and no other.
    cut_off, emptied, changed = sorted(tmp_path.iterdir())[:3]
    before = changed.read_bytes()
    cut_off.write_bytes(cut_off.read_bytes()[:-8])
    emptied.write_bytes(b"")
    changed.write_bytes(before[:500] + bytes([before[500] ^ 1]) + before[501:])
    simulated.clear()
    again = fit_stripes(short, target, 0.2, starts=1, kept=tmp_path)
    assert len(simulated) == 3
    assert again.factors == resumed.factors
    assert changed.read_bytes() == before


@pytest.mark.slow
@pytest.mark.nightly
def test_a_test_that_fails_midway_is_skipped(case, truth):
    # So far away that no state converges: the search must take a shorter step, not end.
    assert simulated_test(with_factors(case, {"rib_k_s": 1e-9}), truth) is None


@pytest.mark.slow
@pytest.mark.nightly
def test_the_report_and_the_stripe_file_state_what_changed(tmp_path, fit):
    text = "\n".join(fit.report)
    for name in FITTED:
        assert name in text
    assert "RMS difference" in text
    path = tmp_path / "fitted.toml"
    fit.material(tmp_path / "cube.nc").write(path)
    assert read_toml(path)["rib"]["n"]["4"]["k_t"] == pytest.approx(fit.after.weft.k_t, rel=1e-5)
    # They can be used as they are.
    (used,) = make_plan("laboratory", (*PERIODIC, f"material={path}")).cases.values()
    assert used.warp.theta_0 == pytest.approx(fit.after.warp.theta_0, rel=1e-5)


def experiment(case, truth, **changes):
    import xarray as xr

    design = {dim: [label] for dim, label in case.design.items()}
    dims = (*case.design, "applied_strain")
    values = np.insert(truth.values, 0, 0.0, axis=1)
    cube = xr.Dataset(
        {name: (dims, row[None, None]) for name, row in zip(QUANTITIES, values, strict=True)}
        | {"status": (tuple(case.design), np.full((1, 1), Status.ok, np.int8))},
        {**design, "applied_strain": list(STRAINS), "source": "bench"},
        {"parameters": '{"unit_cells": [2, 2]}'},
    )
    for name in QUANTITIES:
        cube[f"{name}_error"] = 0 * cube[name]
    return cube.assign_coords(**changes)


@pytest.mark.slow
def test_a_target_has_the_size_of_the_sample_and_the_requested_errors(case, truth):
    target = measured_test(experiment(case, truth), case, model_error=0.01)
    assert target.applied_strain == STRAINS[1:]
    # The experiment is two unit cells wide, the case one.
    np.testing.assert_allclose(target.values[:2], truth.values[:2])
    np.testing.assert_allclose(target.values[2], truth.values[2] / 2)
    largest = np.abs(target.values).max(axis=1, keepdims=True)
    np.testing.assert_allclose(target.errors, 0.01 * largest * np.ones(len(STRAINS) - 1))


@pytest.mark.slow
def test_experiments_that_cannot_be_fitted_are_refused(case, truth):
    plan = make_plan("laboratory", PERIODIC)
    cube = experiment(case, truth)
    assert case_for(plan, cube).design == case.design
    two = make_plan("laboratory", (*PERIODIC, "k_wall=50,100"))
    short = cube.isel(applied_strain=[0, 1, 2])
    for attempt, part in (
        (lambda: case_for(plan, experiment(case, truth, source="simulation")), "simulated"),
        (lambda: case_for(plan, experiment(case, truth, n_stripe=[6], n_subunit=[24])), "has 0"),
        (lambda: case_for(two, cube), "has 2"),
        (lambda: measured_test(cube, case, model_error=0.0), "above 0"),
        (lambda: measured_test(short, case, model_error=0.01), "3 strains"),
    ):
        with refused(part):
            attempt()


@pytest.mark.slow
def test_a_simulated_test_gives_the_results_of_a_sweep(case):
    net, fabric = case.assemble()
    test = stretch(equations(net, fabric), STRAINS, case.equilibrium_solver)
    force = [test.loading.reaction_force(state.gradient) for state in test.states[1:]]
    np.testing.assert_allclose(simulated_test(case).values[2], force, rtol=1e-9)
