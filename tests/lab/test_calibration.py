"""Calibration recovers a known stripe, and reports when a curve does not determine it."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

import knitlab as kl
from knitlab.lab.along_ridges import springs_along
from knitlab.lab.calibration import FITTED
from knitlab.lab.tension_record import TensionRecord
from knitlab.model.pure_stripe import PureStripe, tension_across, tension_along
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe import Stripe
from tests.fabrics import DISTINCT_STRIPES, compiled_tension_across, stripe
from tests.refusals import refused

POINTS, NOISE, SEEDS = 41, 0.01, 40


def curve(of, largest=2.0, noise=NOISE, seed=0):
    strain = np.linspace(0, largest, POINTS)
    force = np.asarray(compiled_tension_across(PureStripe.of(of), jnp.asarray(strain)))
    return strain, force + noise * force.max() * np.random.default_rng(seed).normal(size=POINTS)


@pytest.mark.slow
@DISTINCT_STRIPES
def test_a_clean_curve_gives_its_stripe_back_in_both_conventions(of):
    fit = kl.calibrate(*curve(of, noise=0.0), period=of.period)
    assert fit.usable
    assert fit.warnings == ()
    for name in FITTED:
        assert fit.values[name] == pytest.approx(getattr(of, name), rel=1e-6)
    relaxed, flat = fit.stripe(of.knit, of.n, "relaxed"), fit.stripe(of.knit, of.n, "flat")
    assert relaxed.period == of.period
    assert flat.period == pytest.approx(of.period / of.contraction, rel=1e-6)
    assert replace(flat, period=relaxed.period) == relaxed


@pytest.mark.slow
@pytest.mark.nightly
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
    fit = kl.calibrate(strain, across, period=10.0, per_width=True, along=(ridges, along))
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
    for swatch in kl.simulated_swatches(fit):
        assert swatch.error < 0.02 + 4 * noise


def test_a_force_along_the_ridges_that_falls_is_evened_out():
    sheet = PureStripe.of(stripe("rib", 4))
    strain = np.linspace(0.02, 0.3, 15)
    force = 0.02 * strain
    force[7] *= 0.5
    found = springs_along(sheet, TensionRecord(strain, force[None], per_width=True))
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
    fit = kl.calibrate(strain, np.array(force), period=10.0, per_width=True)
    assert fit.standard_errors["k_s"] > 0.01 * fit.values["k_s"]
    error = fit.standard_errors["theta_0"]
    assert fit.covariance["theta_0"]["theta_0"] == pytest.approx(error**2)
    assert fit.covariance["k_s"]["k_s"] < 1e-6
    assert fit.covariance["k_t"]["k_t"] < 1e-6


@pytest.mark.parametrize("factor", [0.5, 1.2, 4.0])
def test_springs_along_the_ridges_may_be_stiffer_than_those_across(factor):
    """Then diagonals have the law of those across."""
    of = stripe("rib", 4)
    sheet = PureStripe.of(replace(of, stretch_along=factor * of.k_s))
    strain = np.linspace(0.0, 0.6, 40)
    force = np.asarray(tension_along(sheet, jnp.asarray(strain)))
    found = springs_along(PureStripe.of(of), TensionRecord(strain, force[None]))
    assert found.stretch == pytest.approx(factor * of.k_s, rel=0.01)
    np.testing.assert_allclose(found.fitted_force, force, atol=0.002 * force.max())


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(("knit", "n"), [("rib", 4), ("garter", 16)])
def test_errors_correlations_and_misfit_are_those_of_repeated_measurements(knit, n):
    of = stripe(knit, n)
    fits = [kl.calibrate(*curve(of, seed=seed), period=of.period) for seed in range(SEEDS)]
    assert all(fit.starts[1] > 1 for fit in fits)
    values = np.array([[fit.values[name] for name in FITTED] for fit in fits])
    errors = np.mean([[fit.standard_errors[name] for name in FITTED] for fit in fits], axis=0)
    np.testing.assert_allclose(errors, values.std(axis=0, ddof=1), rtol=0.35)
    np.testing.assert_allclose(fits[0].correlations, np.corrcoef(values.T), atol=0.1)
    noise = NOISE * curve(of, noise=0.0)[1].max()
    assert np.mean([fit.misfit for fit in fits]) == pytest.approx(noise, rel=0.1)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_curve_too_short_to_separate_two_parameters_warns():
    fit = kl.calibrate(*curve(stripe("rib", 4), largest=0.3), period=1.41)
    assert {"k_t", "theta_0"} <= {*fit.undetermined}
    # Without noise, too: the springs have hardly stretched.
    fit = kl.calibrate(*curve(stripe("rib", 4), largest=0.5, noise=0.0), period=1.41)
    assert "k_s" in fit.undetermined
    assert fit.wanted_strain > 1.5
    straight = np.linspace(0, 0.02, 20)
    fit = kl.calibrate(straight, 0.02 * straight, period=1.41)
    assert fit.warnings
    assert not fit.usable
    assert 0 <= fit.intervals["theta_0"][0] < fit.intervals["theta_0"][1] <= np.pi


RISING = np.linspace(0.0, 2.0, 9)


@pytest.mark.parametrize(
    ("across", "along", "parts"),
    [
        ((np.arange(3.0), np.arange(3.0)), None, ("curve", "3 points", "at least 4")),
        ((np.arange(5.0), np.zeros(5)), None, ("curve", "zero", "give")),
        ((np.arange(5.0), -np.arange(5.0)), None, ("curve", "give tension as positive")),
        ((RISING, RISING), ([0.1, 0.2, 0.3], [1, 2, 3]), ("along", "3 points", "give 4")),
        ((RISING, RISING), ([0, 0.1, 0.2, 0.3], [0, -1, -2, -3]), ("along", "-3 at", "positive")),
        ((RISING, RISING), ([-0.1, 0.1, 0.2, 0.3], [0, 1, 2, 3]), ("along", "-0.1", "from 0 up")),
    ],
)
def test_curves_that_cannot_be_fitted_are_refused(across, along, parts):
    with refused(*parts):
        kl.calibrate(*across, period=1.41, along=along)
