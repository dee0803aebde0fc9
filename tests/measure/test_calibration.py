"""Calibration recovers a known stripe, and reports when a curve does not determine it."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.fabric.settings import ModelOptions
from knitlab.fabric.zigzag import zigzag
from knitlab.measure.calibration import FITTED, calibrate
from tests.fabrics import DISTINCT_STRIPES, compiled_tension, stripe

POINTS, NOISE, SEEDS = 41, 0.01, 40


def curve(of, largest=2.0, noise=NOISE, seed=0):
    strain = np.linspace(0, largest, POINTS)
    force = np.asarray(compiled_tension(zigzag(of), jnp.asarray(strain)))
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
@pytest.mark.parametrize("cell_size", ["flat", "relaxed"])
@DISTINCT_STRIPES
def test_a_fitted_stripe_has_the_measured_curve_with_the_cell_size_it_is_fitted_for(of, cell_size):
    strain, force = curve(of, noise=0.0)
    fit = calibrate(of.period, strain, force)
    tabulated = fit.stripe(of.knit, of.n, cell_size)
    read = zigzag(tabulated, ModelOptions(cell_size=cell_size))
    np.testing.assert_allclose(
        compiled_tension(read, jnp.asarray(strain)), force, rtol=1e-5, atol=1e-6 * force.max()
    )


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
    assert any("cannot separate k_t and theta_0" in warning for warning in fit.warnings)
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
