"""Control by force: against closed forms, and fabric under a dead load."""

import jax
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from knitlab.cube.force_control import under_force
from knitlab.cube.selection import selected
from knitlab.equilibrium.tensile_test import stretch
from knitlab.fabric.energy import energy
from knitlab.fabric.fabric import Configuration
from knitlab.fabric.network import network
from knitlab.io.errors import BadInput
from tests.fabrics import FINE, PERIODIC, checkered, equations

STRAINS = np.array([0.0, 0.1, 0.2, 0.3, 0.4])


def cube_of(force, **curves):
    """A made-up cube of two designs, the second of which is twice as stiff."""
    force = np.array(force, float)
    variables = {"reaction_force": (("n_stripe", "applied_strain"), np.stack([force, 2 * force]))}
    variables |= {name: ("applied_strain", np.array(curve)) for name, curve in curves.items()}
    return xr.Dataset(variables, {"n_stripe": [2, 4], "applied_strain": STRAINS})


def test_a_linear_force_is_read_at_its_strain():
    """With F = 10 ε and 20 ε, whatever is linear in ε is linear in F."""
    cube = cube_of(10 * STRAINS, poisson_ratio=[np.nan, -0.5, -0.4, -0.3, -0.2])
    read = under_force(cube, "reaction_force", [0.0, 0.5, 3.3, 4.0, 7.0, 9.0])
    assert read["applied_strain"].dims == ("n_stripe", "reaction_force")
    strains = np.array([[0, 0.05, 0.33, 0.4, np.nan, np.nan], [0, 0.025, 0.165, 0.2, 0.35, np.nan]])
    np.testing.assert_allclose(read["applied_strain"], strains, atol=1e-12)
    # Zero strain has no ratio of its own.
    np.testing.assert_allclose(read["poisson_ratio"], np.maximum(strains, 0.1) - 0.6, atol=1e-12)
    assert not read["jumped"].any()


def test_a_test_that_controls_the_force_jumps_past_its_maximum():
    cube = cube_of([0, 2, 1, 3, 5], snapped=[0, 0, 1, 1, 1])
    read = under_force(cube, "reaction_force", [1.5, 2.0, 2.5]).sel(n_stripe=2)
    np.testing.assert_allclose(read["applied_strain"], [0.075, 0.1, 0.275])
    np.testing.assert_array_equal(read["jumped"], [0, 0, 1])
    # A flag that differs at both ends is that of neither.
    np.testing.assert_array_equal(read["snapped"], [0, 0, 1])


def test_a_state_that_is_missing_is_not_bridged():
    read = under_force(cube_of([0, 2, np.nan, 6, 8]), "reaction_force", [1, 2, 4, 7])
    found = read["applied_strain"].sel(n_stripe=2)
    np.testing.assert_allclose(found, [0.05, 0.1, np.nan, 0.35])


@given(st.lists(st.floats(0.01, 5), min_size=4, max_size=4), st.floats(0, 1))
def test_the_force_at_the_strain_that_is_read_is_the_one_selected(steps, fraction):
    force = np.concatenate([[0], np.cumsum(steps)])
    wanted = fraction * force[-1]
    read = selected(cube_of(force), {"reaction_force": wanted}).sel(n_stripe=2)
    np.testing.assert_allclose(np.interp(read["applied_strain"], STRAINS, force), wanted, atol=1e-9)


@pytest.mark.parametrize(
    "selections",
    [
        {"reaction_force": -1},
        {"reaction_force": "much"},
        {"reaction_force": []},
        {"reaction_force": np.nan},
        {"reaction_force": 1, "applied_strain": 0.1},
        {"force_per_width": 1},
    ],
)
def test_forces_that_cannot_be_selected_are_refused(selections):
    with pytest.raises(BadInput, match="force"):
        selected(cube_of(STRAINS), selections)


@pytest.mark.slow
def test_the_strain_under_a_force_is_that_of_fabric_under_a_dead_load():
    """A second method: V - F L_y is minimised with all unknowns free."""
    net, fabric = checkered(2, 1, PERIODIC)
    strains = np.linspace(0, 0.1, 21)
    test = stretch(equations(net, fabric), list(strains), FINE)
    forces = [test.loading.reaction_force(state.gradient) for state in test.states]
    cube = xr.Dataset(
        {"reaction_force": ("applied_strain", np.array(forces))}, {"applied_strain": strains}
    )
    wanted = 0.6 * forces[-1]
    read = float(under_force(cube, "reaction_force", [wanted])["applied_strain"].item())

    @jax.jit
    @jax.value_and_grad
    def loaded(unknowns):
        at = Configuration.of(unknowns, net.shape)
        return energy(network(net.shape), fabric, at).total - wanted * at.lengths[1]

    relaxed = test.states[0].configuration
    found = minimize(
        lambda q: [np.asarray(each, float) for each in loaded(q)],
        np.asarray(relaxed.flattened()),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 20000, "maxfun": 40000, "ftol": 1e-16, "gtol": 1e-8},
    )
    length = Configuration.of(found.x, net.shape).lengths[1]
    assert 0.03 < read < 0.1
    assert length / relaxed.lengths[1] - 1 == pytest.approx(read, abs=2e-4)
