"""The zigzag's closed form, against the equations of balance and finite differences."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.zigzag import Zigzag, chain_energy, relaxed_chain, tension, zigzag
from tests.fabrics import ALL_STRIPES, compiled_tension, stripe

STRAINS = jnp.linspace(0, 2, 41)
STRIPES = pytest.mark.parametrize("of", ALL_STRIPES, ids=lambda of: f"{of.knit} {of.n}")


@STRIPES
def test_the_relaxed_chain_has_the_measured_period_and_no_energy(of):
    nodes = relaxed_chain(zigzag(of), periods=3)
    assert float(nodes[-1, 0]) == pytest.approx(3 * of.period)
    assert float(chain_energy(zigzag(of), nodes)) == pytest.approx(0, abs=1e-25)


@pytest.mark.slow
@STRIPES
def test_tension_meets_the_balance_of_moment_and_length(of):
    """k_t (θ − θ0) = F ℓ cos(θ/2), ℓ = cell + F sin(θ/2) / k_s, period = 4 ℓ sin(θ/2)."""
    force = np.asarray(compiled_tension(zigzag(of), STRAINS))
    cell = of.period / (4 * np.sin(of.theta_0 / 2))
    # θ from the moment only, by bisection; the period is compared.
    low, high = np.full_like(force, of.theta_0), np.full_like(force, np.pi)
    for _ in range(60):
        theta = (low + high) / 2
        length = cell + force * np.sin(theta / 2) / of.k_s
        folds = of.k_t * (theta - of.theta_0) < force * length * np.cos(theta / 2)
        low, high = np.where(folds, theta, low), np.where(folds, high, theta)
    length = cell + force * np.sin(theta / 2) / of.k_s
    np.testing.assert_allclose(
        4 * length * np.sin(theta / 2), of.period * (1 + np.asarray(STRAINS)), rtol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "k_t",
        "theta_0",
        *(pytest.param(each, marks=pytest.mark.nightly) for each in ("k_s", "period")),
    ],
)
def test_tension_has_the_slopes_that_differences_give(name):
    of, step = stripe("garter", 8), 1e-5

    def force(value):
        return compiled_tension(zigzag(replace(of, **{name: float(value)})), STRAINS)

    def traced(value):
        numbers = {
            key: jnp.asarray(getattr(of, key)) for key in ("period", "k_s", "k_t", "theta_0")
        }
        return tension(Zigzag(**numbers | {name: value}), STRAINS)

    value = getattr(of, name)
    expected = (force(value + step) - force(value - step)) / (2 * step)
    for derivative in (jax.jacfwd, jax.jacrev):
        slopes = derivative(traced)(jnp.asarray(value))
        np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-7)


@given(
    k_s=st.floats(0.1, 10),
    k_t=st.floats(1e-3, 0.5),
    theta_0=st.floats(0.3, 2.5),
    period=st.floats(0.5, 5),
)
def test_tension_rises_with_strain_and_scales_as_its_units_say(k_s, k_t, theta_0, period):
    strains = jnp.linspace(0, 2, 9)
    force = np.asarray(compiled_tension(_chain(period, k_s, k_t, theta_0), strains))
    assert force[0] == pytest.approx(0, abs=1e-9 * force[-1])
    assert (np.diff(force) > 0).all()
    stiffer = np.asarray(compiled_tension(_chain(period, 3 * k_s, 3 * k_t, theta_0), strains))
    np.testing.assert_allclose(stiffer[1:], 3 * force[1:], rtol=1e-8)
    larger = np.asarray(compiled_tension(_chain(2 * period, k_s, 4 * k_t, theta_0), strains))
    np.testing.assert_allclose(larger[1:], 2 * force[1:], rtol=1e-8)


def _chain(*numbers: float) -> Zigzag:
    return Zigzag(*(jnp.asarray(number) for number in numbers))
