"""95 % intervals cover: simulated repeats and curves of a known stripe, from fit to design."""

from functools import cache
from unittest.mock import patch

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.linalg import toeplitz

import knitlab as kl
from knitlab.cubes.uncertainty import NUMBERS, first_order
from knitlab.lab import calibration
from knitlab.lab.calibration import FITTED
from knitlab.lab.fit_statistics import errors_by_residuals
from knitlab.model.pure_stripe import PureStripe
from knitlab.observables.status import Status
from knitlab.runs.stripe_covariance import uncertain_stripes
from tests.fabrics import compiled_tension_across

PERIOD, MIDDLE = 10.0, np.array([np.log(2.6), np.log(0.93), 0.74])
ROOT = np.array([[0.06, 0, 0], [0.02, 0.04, 0], [-0.01, 0.005, 0.02]])
"""Swatches are normal: ln k_s, ln k_t and θ0 are the middle plus this times normal deviates."""
STRAIN = np.linspace(0, 2.3, 18)
NOISE = 0.001  # of the force of single points, over the largest
TRIALS = 200
PARAMETERS = [f"{knit}_{name}" for knit in ("rib", "garter") for name in NUMBERS]
SLOPES = {
    "k_s of the rib": {"rib_k_s": 1.0},
    "k_t of the rib": {"rib_k_t": 1.0},
    "theta_0 of the rib": {"rib_theta_0": 1.0},
    "both": {"rib_k_s": 0.2, "rib_theta_0": -0.8, "garter_k_t": 0.7, "garter_theta_0": 1.0},
}
"""Quantities that are linear in the parameters, by their slopes."""


def swatches(generator, count):
    return MIDDLE + generator.normal(size=(count, 3)) @ ROOT.T


def force_of(numbers, strain=STRAIN):
    k_s, k_t = np.exp(numbers[:2])
    of = kl.Stripe("rib", 4, period=PERIOD, k_s=k_s, k_t=k_t, theta_0=numbers[2])
    return np.asarray(compiled_tension_across(PureStripe.of(of), jnp.asarray(strain)))


def one_start():
    """Fits from one start near the truth, as these tests are about errors."""
    return patch.multiple(calibration, STARTING_ANGLES=(0.8,), STARTING_FACTORS=(1.0,))


@cache
def fits(repeats):
    """Fits to simulated repeats of different samples of swatches."""
    generator = np.random.default_rng(repeats)
    made = []
    with one_start():
        for _ in range(TRIALS):
            force = np.array([force_of(each) for each in swatches(generator, repeats)])
            force += NOISE * force.max() * generator.normal(size=force.shape)
            made.append(kl.calibrate(STRAIN, force, period=PERIOD))
    return made


def cube_of(stripes):
    """Designs whose ratios have these slopes, at one strain."""
    dims = ("n_stripe", "n_subunit")
    slopes = [[each.get(name, 0.0) for name in PARAMETERS] for each in SLOPES.values()]
    shape = 1, len(slopes), 1
    numbers = {
        f"{each.knit}_{name}": (dims, np.full(shape[:2], getattr(each, name)))
        for each in stripes
        for name in NUMBERS
    }
    variables = {
        "status": (dims, np.full(shape[:2], Status.ok, np.int8)),
        "poisson_ratio": ((*dims, "applied_strain"), np.zeros(shape)),
        "poisson_ratio_sensitivity": (
            (*dims, "applied_strain", "stripe_parameter"),
            np.reshape(slopes, (*shape, -1)),
        ),
    }
    coordinates = {
        "n_stripe": [4],
        "n_subunit": 8 * np.arange(1, len(slopes) + 1),
        "applied_strain": [0.1],
        "stripe_parameter": PARAMETERS,
    }
    return xr.Dataset(variables | numbers, coordinates)


def change(fitted, truth, knit, slopes):
    """Change of a linear quantity from the fitted stripe to another one."""
    values = np.array([fitted.values[name] for name in FITTED])
    relative = np.array([*(truth[:2] - np.log(values[:2])), truth[2] / values[2] - 1])
    return sum(
        slopes.get(f"{knit}_{name}", 0.0) * each
        for name, each in zip(FITTED, relative, strict=True)
    )


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("subject", ["swatch", "mean"])
@pytest.mark.parametrize("repeats", [3, 5, 10])
def test_intervals_of_few_repeats_cover(repeats, subject):
    generator = np.random.default_rng(0)
    made, covered = fits(repeats), []
    for rib, garter in zip(made, [*made[1:], made[0]], strict=True):
        stripes = rib.stripe("rib", 4, "relaxed"), garter.stripe("garter", 8, "relaxed")
        tables = {("rib", 4): rib.covariance, ("garter", 8): garter.covariance}
        known = uncertain_stripes(kl.Material(stripes, covariances=tables), subject)
        truths = swatches(generator, 2) if subject == "swatch" else [MIDDLE, MIDDLE]
        found = first_order(cube_of(stripes), known)["poisson_ratio_halfwidth"].values.ravel()
        errors = [
            change(rib, truths[0], "rib", slopes) + change(garter, truths[1], "garter", slopes)
            for slopes in SLOPES.values()
        ]
        covered.append(np.abs(errors) <= found)
    shares = dict(zip(SLOPES, np.mean(covered, axis=0), strict=True))
    assert 0.92 <= np.mean(covered) <= 0.98, shares
    assert all(0.9 <= each <= 0.99 for each in shares.values()), shares


def correlated(generator, rho, count):
    return np.linalg.cholesky(toeplitz(rho ** np.arange(count))) @ generator.normal(size=count)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_intervals_of_one_curve_cover_the_curve_with_correlated_noise(rho):
    generator, strain = np.random.default_rng(1), np.linspace(0, 2.3, 41)
    force, covered, warned = force_of(MIDDLE, strain), [], []
    truth = np.array([*np.exp(MIDDLE[:2]), MIDDLE[2]])
    for _ in range(TRIALS):
        noise = 0.01 * force.max() * correlated(generator, rho, len(strain))
        with one_start():
            fit = kl.calibrate(strain, force + noise, period=PERIOD)
        low, high = np.array([fit.intervals[name] for name in FITTED]).T
        covered.append((low <= truth) & (truth <= high))
        warned.append(any("correlated" in warning for warning in fit.warnings))
        assert fit.covariance.repeats is None
    assert 0.92 <= np.mean(covered) <= 0.98
    assert np.mean(warned) < 0.05 if rho == 0 else np.mean(warned) > 0.8


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.9])
def test_errors_of_a_linear_fit_cover_with_correlated_residuals(rho):
    generator, at = np.random.default_rng(2), np.linspace(0, 1, 60)
    model = np.column_stack([np.ones_like(at), at, at**2])
    covered = []
    for _ in range(200):
        noise = correlated(generator, rho, len(at))
        fitted, *_ = np.linalg.lstsq(model, noise)
        covered.append(abs(fitted) <= errors_by_residuals(model, noise - model @ fitted).halfwidths)
    assert 0.92 <= np.mean(covered) <= 0.99
