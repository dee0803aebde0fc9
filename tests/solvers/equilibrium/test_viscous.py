"""Viscous strain steps, against an integration of c u̇ + ∇V = 0 by another method."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from knitlab.model.energy import COMPLETE
from knitlab.model.settings import ModelOptions
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.tensile_test import stretch
from tests.fabrics import FINE, checkered, equations

READING = ModelOptions(boundary="clamped")
STRAINS = [0.0, 0.1, 0.2]
DRAG = 2e-3
"""Large enough to change the states of a sample of one unit cell [N/mm]."""


@pytest.fixture(scope="module")
def sample():
    return checkered(4, 1, READING, unit_cells=(2, 1))


def pulled(sample, drag, path_step=0.1):
    net, fabric = sample
    settings = replace(FINE, tolerance=1e-10, drag=drag, path_step=path_step)
    return stretch(equations(net, fabric), STRAINS, settings)


def integrated(sample, test, drag):
    """The same test by a Runge–Kutta integrator, with the applied strain instead of time."""
    net, fabric = sample
    loading, free = test.loading, test.loading.free
    chunked = ChunkedFabric(net.shape, fabric)

    def velocity(strain, moving):
        current = loading.holding(loading.reference, strain)
        current[free] = moving
        return -np.asarray(chunked.evaluate(COMPLETE, current).gradient)[free] / drag

    return solve_ivp(
        velocity,
        (0.0, STRAINS[-1]),
        loading.reference[free],
        method="RK45",
        t_eval=STRAINS,
        rtol=1e-6,
        atol=1e-8,
    ).y.T


@pytest.mark.slow
@pytest.mark.nightly
def test_viscous_steps_converge_to_the_integrated_motion(sample):
    tests = [pulled(sample, DRAG, step) for step in (0.1, 0.025, 0.00625)]
    free = tests[0].loading.free
    expected = integrated(sample, tests[0], DRAG)
    still = np.array([s.unknowns[free] for s in pulled(sample, 0.0).states])
    lag = np.abs(still - expected).max()
    errors = [
        np.abs(np.array([s.unknowns[free] for s in test.states]) - expected).max() for test in tests
    ]
    assert lag > 0.05
    # Implicit Euler is of first order: a quarter of the step has about a quarter of the error.
    assert errors[1] < 0.4 * errors[0]
    assert errors[2] < 0.4 * errors[1]
    assert errors[2] < 0.05 * lag


def test_forces_and_drag_balance_on_every_free_unknown(sample):
    test = pulled(sample, DRAG)
    free = test.loading.free
    assert all(state.converged for state in test.states)
    for before, state in zip(test.states, test.states[1:], strict=False):
        moved = state.unknowns[free] - before.unknowns[free]
        left = state.gradient[free] + DRAG / 0.1 * moved
        assert np.abs(left).max() <= 1e-10
        assert np.abs(state.gradient[free]).max() > 1e-6
        assert float(state.energy.drag) == 0


@pytest.mark.slow
def test_small_drag_gives_the_equilibria(sample):
    still, slow = pulled(sample, 0.0), pulled(sample, 1e-9)
    for one, other in zip(still.states, slow.states, strict=True):
        np.testing.assert_allclose(other.unknowns, one.unknowns, atol=1e-5)


@pytest.mark.slow
def test_the_pull_does_the_work_that_is_stored_and_dissipated(sample):
    net, fabric = sample
    strains = np.linspace(0.0, 0.1, 81)
    settings = replace(FINE, tolerance=1e-10, drag=DRAG, path_step=1.0)
    test = stretch(equations(net, fabric), list(strains), settings)
    free, length = test.loading.free, test.loading.length
    moved = np.diff([state.unknowns[free] for state in test.states], axis=0)
    dissipated = float(np.sum(DRAG * moved**2 / np.diff(strains)[:, None]))
    stored = float(test.states[-1].energy.total - test.states[0].energy.total)
    forces = np.array([test.loading.reaction_force(state.gradient) for state in test.states])
    work = float(np.sum(np.diff(strains) * length * (forces[1:] + forces[:-1]) / 2))
    assert dissipated > 0.1 * work
    assert work == pytest.approx(stored + dissipated, rel=0.02)
