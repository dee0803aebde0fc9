"""Tests of fabric in contact with itself under drag, shear and friction: balances and limits."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.contact_layers import contact_layers
from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration
from knitlab.model.network import network
from knitlab.model.settings import Friction
from knitlab.solvers.equilibrium.adjoint import LinearResponse
from knitlab.solvers.equilibrium.contact_barrier import Barrier
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads.loading import all_free
from knitlab.solvers.loads.shear import Shear
from tests.fabrics import CLAMPED, FINE, PERIODIC, checkered, equations

SETTINGS = replace(FINE, tolerance=1e-10)
DRAG, STEP = 2e-3, 0.02  # [N/mm], applied strain
STRAINS = [0.0, STEP, 2 * STEP]


def barrier_of(net, fabric):
    cell = float(np.mean(fabric.cell_x)), float(np.mean(fabric.cell_y))
    # Thick enough that plies touch in every state; a sample between clamps folds less sharply.
    thickness = 0.25 if net.shape.periodic else 0.4
    return Barrier(net.shape, contact_layers(thickness, 1.0, cell))


def pulled(net, fabric, strains=STRAINS, drag=0.0, **rules):
    settings = replace(SETTINGS, drag=drag, path_step=STEP if drag else SETTINGS.path_step)
    contact = barrier_of(net, fabric)
    test = stretch(equations(net, fabric, contact), strains, settings, **rules)
    assert all(state.converged for state in test.states)
    return test


def pushed(net, fabric, state):
    """Gradient of the barrier in a state, by a new one."""
    contact = barrier_of(net, fabric).on(state.shape)
    return contact.evaluate(state.unknowns)[1]


def elastic(fabric, state):
    """Gradient of the energy of springs, hinges and walls in a state."""

    def stored(unknowns):
        return energy(network(state.shape), fabric, Configuration.of(unknowns, state.shape)).total

    return np.asarray(jax.grad(stored)(jnp.asarray(state.unknowns)))


@pytest.mark.slow
def test_forces_contact_and_drag_balance_on_every_free_unknown():
    net, fabric = checkered(4, 2, CLAMPED)
    test = pulled(net, fabric, drag=DRAG)
    free = test.loading.free
    for before, state in zip(test.states, test.states[1:], strict=False):
        contact = pushed(net, fabric, state)
        assert np.abs(contact).max() > 1e-4
        moved = state.unknowns - before.unknowns
        left = elastic(fabric, state) + contact + DRAG / STEP * moved
        assert np.abs(left[free]).max() <= 1e-9
        assert np.abs(state.gradient[free]).max() > 1e-6
        assert float(state.energy.contact) > 0
        assert float(state.energy.drag) == 0


@pytest.mark.slow
def test_the_energy_with_contact_grows_by_the_work_of_shear():
    """By Gauss–Legendre quadrature of the force between two strains."""
    net, fabric = checkered(4, 2, PERIODIC)
    points, weights = np.polynomial.legendre.leggauss(3)
    inner = 0.005 + (points + 1) / 2 * 0.005
    test = pulled(net, fabric, [0.0, 0.005, *inner, 0.01], load=Shear())
    assert not any(state.snapped for state in test.states)
    assert all(float(state.energy.contact) > 0 for state in test.states)
    for state in test.states:
        found = elastic(fabric, state) + pushed(net, fabric, state)
        np.testing.assert_allclose(state.gradient, found, atol=1e-9)
    stored = [float(state.energy.total) for state in test.states]
    forces = np.array([test.loading.reaction_force(state.gradient) for state in test.states])
    work = test.loading.length * (forces[2:-1] @ weights) * 0.005 / 2
    assert stored[-1] - stored[1] == pytest.approx(work, rel=1e-4)


@pytest.mark.slow
def test_small_forces_move_fabric_in_contact_as_far_as_they_are_balanced():
    net, fabric = checkered(4, 2, PERIODIC)
    (state,) = pulled(net, fabric, [0.0]).states
    force = np.zeros((1, net.shape.unknowns))
    # Two nodes of a ply are pulled apart, along and across it.
    force[0, [30, 33]], force[0, [32, 35]] = [1.0, -1.0], [0.5, -0.5]
    response = LinearResponse(net.shape, all_free(net.shape))
    (moved,) = response.at(fabric, state.unknowns, barrier_of(net, fabric)).to(force)
    turning = response.rigid_motion(force)
    step = 1e-6 / np.abs(moved).max()
    ahead, behind = (
        replace(state, unknowns=state.unknowns + sign * step * moved) for sign in (1, -1)
    )
    forces = [elastic(fabric, each) + pushed(net, fabric, each) for each in (ahead, behind)]
    found = (forces[0] - forces[1]) / (2 * step)
    np.testing.assert_allclose(found, (force - turning)[0], atol=1e-5)


@pytest.mark.slow
def test_contact_and_friction_balance_and_lose_work_in_a_cycle():
    net, fabric = checkered(4, 2, PERIODIC)
    friction = Friction(fold_friction=0.02, fold_slide=0.002)
    test = pulled(net, fabric, [0.0, 0.005, 0.01], friction=friction, unload=True)
    assert len(test.unloaded) == 2
    free = test.loading.free
    of = test.loading.reaction_force
    for state in (*test.states, *test.unloaded):
        assert float(state.energy.contact) > 0
        assert np.abs(state.gradient[free]).max() <= 1e-10
        # What friction adds to the moments of hinges is in balance with the rest.
        of_hinges = state.gradient - elastic(fabric, state) - pushed(net, fabric, state)
        assert (np.abs(of_hinges).max() > 1e-4) == (state is not test.states[0])
    there, back = (
        np.array([of(state.gradient) for state in each])
        for each in (test.states[:-1], test.unloaded[::-1])
    )
    assert (there > back + 1e-4).all()
