"""Own functions of the shape: their values, and derivatives against finite differences."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

import knitlab as kl

STRAINS = [0.0, 0.03, 0.06]
TIGHT = kl.Solver(tolerance=1e-10)


def thickness(shape):
    return jnp.ptp(shape.positions[..., 2])


def mean_square_height(shape):
    heights = shape.positions[..., 2]
    return jnp.mean((heights - heights.mean()) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "boundary", ["periodic", pytest.param("clamped", marks=pytest.mark.nightly)]
)
def test_derivatives_are_those_of_finite_differences(boundary):
    design = kl.Design(n_stripe=4, n_subunit=8, boundary=boundary)
    evaluated = kl.evaluate(kl.simulate(design, STRAINS, solver=TIGHT), height=mean_square_height)
    rib = kl.defaults().stripes.stripe("rib", 4)
    step = 1e-3
    below, above = (
        kl.evaluate(
            kl.simulate(replace(design, rib=each), STRAINS, solver=TIGHT),
            sensitivities=False,
            height=mean_square_height,
        )["height"]
        for each in (replace(rib, theta_0=rib.theta_0 * (1 + off)) for off in (-step, step))
    )
    slope = evaluated["height_sensitivity"].sel(stripe_parameter="rib_theta_0")
    np.testing.assert_allclose(slope, (above - below) / (2 * step), rtol=1e-3)


@pytest.mark.slow
def test_values_are_those_of_the_positions():
    test = kl.simulate(kl.Design(n_stripe=4, n_subunit=8, boundary="periodic"), STRAINS)
    evaluated = kl.evaluate(test, sensitivities=False, thickness=thickness)
    z = test["position"].sel(component="z")
    expected = z.max(("node_y", "node_x")) - z.min(("node_y", "node_x"))
    np.testing.assert_allclose(evaluated["thickness"], expected)
    assert list(evaluated.data_vars) == ["thickness"]


@pytest.mark.slow
def test_tests_without_positions_and_functions_without_numbers_are_refused():
    test = kl.simulate(kl.Design(n_stripe=4, n_subunit=8, boundary="periodic"), [0.0, 0.03])
    with pytest.raises(kl.InputError, match=r"heights: returns an array of shape \(8, 8\)"):
        kl.evaluate(test, heights=lambda shape: shape.positions[..., 2])
    with pytest.raises(kl.InputError, match="no node positions"):
        kl.evaluate(test.drop_vars("position"), thickness=thickness)
