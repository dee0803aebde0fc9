"""Calibration recovers a known stripe, and reports when a curve does not determine it."""

from dataclasses import replace
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.lab.along_ridges import springs_along
from knitlab.lab.calibration import FITTED, calibrate
from knitlab.lab.swatch import simulated_swatches
from knitlab.model.pure_stripe import PureStripe, tension_across, tension_along
from knitlab.model.spring_law import SpringCurve
from knitlab.model.stripe import Stripe
from tests.fabrics import DISTINCT_STRIPES, compiled_tension_across, stripe

POINTS, NOISE, SEEDS = 41, 0.01, 40


def curve(of, largest=2.0, noise=NOISE, seed=0):
    strain = np.linspace(0, largest, POINTS)
    force = np.asarray(compiled_tension_across(PureStripe.of(of), jnp.asarray(strain)))
    scatter = np.random.default_rng(seed).normal(size=POINTS)
    return strain, force + noise * force.max() * scatter


@pytest.mark.slow
@DISTINCT_STRIPES
def test_a_clean_curve_gives_its_stripe_back(of):
    fit = calibrate(of.period, *curve(of, noise=0.0))
    assert fit.usable
    assert fit.warnings == ()
    for name in FITTED:
        assert fit.values[name] == pytest.approx(getattr(of, name), rel=1e-6)


@pytest.mark.slow
@DISTINCT_STRIPES
def test_a_fitted_stripe_is_one_fabric_in_both_conventions(of):
    fit = calibrate(of.period, *curve(of, noise=0.0))
    relaxed, flat = fit.stripe(of.knit, of.n, "relaxed"), fit.stripe(of.knit, of.n, "flat")
    assert relaxed.period == of.period
    assert flat.period == pytest.approx(of.period / of.contraction, rel=1e-6)
    assert replace(flat, period=relaxed.period) == relaxed


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_stripe_of_its_own_along_the_ridges_comes_back_with_its_swatches(noise):
    shape = SpringCurve((0.0, 0.15, 0.3, 0.5), (0.0, 1.0, 3.0, 9.0))
    of = Stripe(
        "rib", 4, 10.0, k_s=2.6, theta_0=0.74, k_t=0.93, stretch_along=0.03, curve_along=shape
    )
    sheet, random = PureStripe.of(of), np.random.default_rng(1)
    strain, ridges = np.linspace(0, 2.0, 40), np.linspace(0.01, 0.5, 40)
    across = np.asarray(tension_across(sheet, jnp.asarray(strain))) / float(sheet.cell)
    width = float(sheet.cell) * of.contraction
    along = np.asarray(tension_along(sheet, jnp.asarray(ridges))) / width
    across += noise * across.max() * random.normal(size=40)
    along += noise * along.max() * random.normal(size=40)
    fit = calibrate(10.0, strain, across, per_width=True, along=(ridges, along))
    assert fit.usable
    for name in FITTED:
        error = max(3 * fit.standard_errors[name], 0.01 * getattr(of, name))
        assert fit.values[name] == pytest.approx(getattr(of, name), abs=error)
    # Its row is as wide as the cells of its own sheet.
    assert fit.stripe("rib", 4).row_width == pytest.approx(float(sheet.cell), rel=0.02)
    at = np.linspace(0.05, 0.5, 10)
    found = fit.along.stretch * fit.along.curve.spline(at)
    known = of.stretch_along * shape.spline(at)
    np.testing.assert_allclose(found, known, atol=(0.03 + 3 * noise) * known.max())
    for swatch in simulated_swatches(fit):
        assert swatch.apart < 0.02 + 4 * noise


def test_a_force_along_the_ridges_that_falls_is_evened_out():
    sheet = PureStripe.of(stripe("rib", 4))
    strain = np.linspace(0.02, 0.3, 15)
    force = 0.02 * strain
    force[7] *= 0.5
    found = springs_along(sheet, strain, force, per_width=True)
    assert (np.diff(found.curve.force) > 0).all()
    assert found.misfit < 0.2 * force.max()


@pytest.mark.slow
def test_the_covariance_is_of_rows_of_one_width():
    """Swatches whose folds alone differ have the same stiffness over width."""
    strain, force = np.linspace(0, 2.0, 21), []
    for theta_0 in (0.70, 0.74, 0.79):
        cell = float(PureStripe.of(Stripe("rib", 4, 10.0, k_s=1, theta_0=theta_0, k_t=1)).cell)
        sheet = PureStripe.of(
            Stripe("rib", 4, 10.0, k_s=0.4 * cell, theta_0=theta_0, k_t=0.1 * cell)
        )
        force.append(np.asarray(compiled_tension_across(sheet, jnp.asarray(strain))) / cell)
    fit = calibrate(10.0, strain, np.array(force), per_width=True)
    assert fit.standard_errors["k_s"] > 0.01 * fit.values["k_s"]
    assert fit.covariance["theta_0"]["theta_0"] == pytest.approx(
        fit.standard_errors["theta_0"] ** 2
    )
    assert fit.covariance["k_s"]["k_s"] < 1e-6
    assert fit.covariance["k_t"]["k_t"] < 1e-6


@pytest.mark.parametrize("factor", [0.5, 1.2, 4.0])
def test_springs_along_the_ridges_may_be_stiffer_than_those_across(factor):
    """Then diagonals have the law of those across."""
    of = stripe("rib", 4)
    sheet = PureStripe.of(replace(of, stretch_along=factor * of.k_s))
    strain = np.linspace(0.0, 0.6, 40)
    force = np.asarray(tension_along(sheet, jnp.asarray(strain)))
    found = springs_along(PureStripe.of(of), strain, force, per_width=False)
    assert found.stretch == pytest.approx(factor * of.k_s, rel=0.01)
    np.testing.assert_allclose(found.fitted_force, force, atol=0.002 * force.max())


@pytest.mark.parametrize(
    ("strain", "force", "value"),
    [
        ([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], "3 points"),
        ([0.0, 0.1, 0.2, 0.3], [0.0, -1.0, -2.0, -3.0], "-3 at"),
        ([-0.1, 0.1, 0.2, 0.3], [0.0, 1.0, 2.0, 3.0], "-0.1"),
    ],
)
def test_a_curve_along_the_ridges_without_tension_is_refused(strain, force, value):
    sheet = PureStripe.of(stripe("rib", 4))
    with pytest.raises(ValueError, match=f"{value}.*; give"):
        springs_along(sheet, np.array(strain), np.array(force), per_width=True)


@cache
def fits(knit, n):
    of = stripe(knit, n)
    return [calibrate(of.period, *curve(of, seed=seed)) for seed in range(SEEDS)]


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("name", FITTED)
@pytest.mark.parametrize(("knit", "n"), [("rib", 4), ("garter", 16)])
def test_the_stated_intervals_cover_the_truth_as_often_as_they_say(knit, n, name):
    truth = getattr(stripe(knit, n), name)
    covered = [low <= truth <= high for low, high in (f.intervals[name] for f in fits(knit, n))]
    assert 0.85 <= np.mean(covered) <= 1
    errors = [fit.standard_errors[name] for fit in fits(knit, n)]
    spread = np.std([fit.values[name] for fit in fits(knit, n)], ddof=1)
    assert np.mean(errors) == pytest.approx(spread, rel=0.35)
    assert all(fit.starts[1] > 1 for fit in fits(knit, n))


@pytest.mark.slow
@pytest.mark.nightly
def test_correlations_are_those_of_repeated_measurements():
    values = np.array([[fit.values[name] for name in FITTED] for fit in fits("rib", 4)])
    np.testing.assert_allclose(fits("rib", 4)[0].correlations, np.corrcoef(values.T), atol=0.1)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_curve_too_short_to_separate_two_parameters_warns():
    fit = calibrate(1.41, *curve(stripe("rib", 4), largest=0.3))
    assert {"k_t", "theta_0"} <= {*fit.undetermined}
    # Without noise, too: the springs have hardly stretched.
    fit = calibrate(1.41, *curve(stripe("rib", 4), largest=0.5, noise=0.0))
    assert "k_s" in fit.undetermined
    assert fit.wanted_strain > 1.5
    straight = np.linspace(0, 0.02, 20)
    fit = calibrate(1.41, straight, 0.02 * straight)
    assert fit.warnings
    assert not fit.usable
    assert 0 <= fit.intervals["theta_0"][0] < fit.intervals["theta_0"][1] <= np.pi


@pytest.mark.slow
@pytest.mark.nightly
def test_the_misfit_is_the_noise():
    of = stripe("garter", 16)
    noise = NOISE * curve(of, noise=0.0)[1].max()
    assert np.mean([fit.misfit for fit in fits("garter", 16)]) == pytest.approx(noise, rel=0.1)


@pytest.mark.parametrize(
    ("strain", "force", "message"),
    [
        (np.arange(3.0), np.arange(3.0), "at least 4"),
        (np.arange(5.0), np.zeros(5), "force is zero"),
        (np.arange(5.0), -np.arange(5.0), "falls with strain"),
    ],
)
def test_curves_that_cannot_be_fitted_are_refused(strain, force, message):
    with pytest.raises(ValueError, match=message):
        calibrate(1.41, strain, force)
