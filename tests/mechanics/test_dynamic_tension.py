"""Dynamics and the equilibrium solver, two ways to the same states."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.measure.corners import unit_cell_corners
from knitlab.measure.strain import central_mean, local_strain, poisson_ratio
from knitlab.mechanics.dynamic_tension import stretch_by_dynamics
from knitlab.mechanics.dynamics import DynamicsSettings
from knitlab.mechanics.loading import squaring_angle, turned
from knitlab.mechanics.state import Outcome
from knitlab.model.fabric import flat_sheet
from tests.fabrics import CLAMPED, ENDLESS, checkered, moving, shaken, stretched

SETTINGS = DynamicsSettings()
STRAINS = [0.0, 0.1, 0.2, 0.3]
PATCHES = (2, 2)
"""Of a single unit cell; between clamps only the corners of its patches can move across."""


def patch_poisson_ratio(shape, test):
    configurations = jnp.array([state.configuration for state in test.states])
    corners = unit_cell_corners(shape, PATCHES, configurations)
    strain_xx, strain_yy = local_strain(corners[0], corners)
    return np.asarray(poisson_ratio(central_mean(strain_xx), central_mean(strain_yy)))[1:]


@pytest.mark.parametrize("reading", [CLAMPED, ENDLESS], ids=["clamped", "endless"])
def test_both_methods_reach_the_same_states(reading):
    net, fabric = checkered(4, 2, reading)
    in_equilibrium = stretched(net, fabric, STRAINS)
    batch = moving([(4, 2)], reading, SETTINGS)
    (by_dynamics,) = stretch_by_dynamics(batch, [STRAINS])
    for test in (in_equilibrium, by_dynamics):
        assert [state.outcome for state in test.states] == [Outcome.converged] * len(STRAINS)
    energies = np.array(
        [
            [float(state.energy.total) for state in test.states]
            for test in (in_equilibrium, by_dynamics)
        ]
    )
    ratios = np.array(
        [patch_poisson_ratio(net.shape, test) for test in (in_equilibrium, by_dynamics)]
    )
    assert energies[1, 0] == pytest.approx(energies[0, 0], rel=1e-7)
    # Endless (4,16) snaps just beyond 10 % strain, and what still moves snaps a little earlier.
    snapping = np.array([reading is ENDLESS, False, False])
    np.testing.assert_allclose(ratios[1], ratios[0], rtol=0.01, err_msg=str(energies))
    np.testing.assert_allclose(ratios[1, ~snapping], ratios[0, ~snapping], rtol=2e-3)
    assert (energies[1, 1:][snapping] < energies[0, 1:][snapping] * (1 + 1e-4)).all()
    np.testing.assert_allclose(energies[1, 1:][~snapping], energies[0, 1:][~snapping], rtol=1e-4)


def test_a_hasty_pull_is_told_and_a_slower_one_is_quasi_static():
    slow = replace(SETTINGS, haste_limit=0.05)
    (test,) = stretch_by_dynamics(moving([(8, 1)], ENDLESS, slow), [[0.0, 0.05]])
    assert test.states[-1].converged
    assert test.states[-1].kinetic_peak < 0.05 * float(test.states[-1].energy.total)

    hasty = replace(slow, ramp_rate=20.0, smallest_rate=1.0)
    (test,) = stretch_by_dynamics(moving([(8, 1)], ENDLESS, hasty), [[0.0, 0.05, 0.1]])
    assert [state.outcome for state in test.states] == [Outcome.converged, Outcome.too_fast]
    assert test.states[-1].kinetic_peak > 0.05 * float(test.states[-1].energy.total)


def test_one_test_that_ends_does_not_end_its_neighbour():
    batch = moving([(4, 1), (8, 1)], ENDLESS, replace(SETTINGS, ramp_rate=0.2, haste_limit=10.0))
    told = []
    strains = [0.0, 0.05, 0.1]
    tests = stretch_by_dynamics(
        batch, [[0.0, np.nan, np.nan], strains], lambda case, done: told.append((case, done))
    )
    assert len(tests[0].states) == 2
    assert not tests[0].states[-1].converged
    assert [state.converged for state in tests[1].states] == [True] * 3
    alone = moving([(8, 1)], ENDLESS, batch.settings)
    (honest,) = stretch_by_dynamics(alone, [strains])
    assert float(tests[1].states[-1].energy.total) == pytest.approx(
        float(honest.states[-1].energy.total), rel=1e-5
    )
    assert told == [(0, 1), (1, 1), (0, 2), (1, 2), (1, 3)]


@pytest.mark.parametrize("angle", [-1.0, 0.07, 3.0])
def test_a_sample_that_turned_is_squared_up(angle):
    net, fabric = checkered(4, 1, CLAMPED)
    flat = np.asarray(flat_sheet(net, fabric))
    skewed = turned(flat, angle)
    assert squaring_angle(net.shape, flat, skewed) == pytest.approx(-angle)
    np.testing.assert_allclose(turned(skewed, -angle), flat, atol=1e-12)
    shape = np.asarray(shaken(jnp.asarray(flat), 0.05))
    square = turned(shape, squaring_angle(net.shape, flat, shape))
    again = turned(turned(shape, angle), squaring_angle(net.shape, flat, turned(shape, angle)))
    np.testing.assert_allclose(again, square, atol=1e-12)
