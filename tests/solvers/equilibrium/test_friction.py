"""Friction at the folds: a scalar return mapping, closed cycles, work against energy lost."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import root

from knitlab.model.energy import Point, energy, fold_angles
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.fold_friction import FoldFriction
from knitlab.model.settings import Friction
from knitlab.solvers.branches.equations import symmetric_stiffness
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads.loading import all_free
from tests.fabrics import DISTINCT_STRIPES, FINE, PERIODIC, checkered, equations, pure, shaken
from tests.solvers.equilibrium.test_pure_stripes import cell_forces

PLAIN = Friction(fold_friction=0.2)
HARDENING = Friction(fold_friction=0.1, fold_slide=0.02, fold_hardening=0.3)


def cycled(net, fabric, strains, friction, cycle=1):
    """Forces of loading, and of unloading at the same strains but the last [N]."""
    test = stretch(
        equations(net, fabric), strains, FINE, unload=True, friction=friction, cycle=cycle
    )
    assert all(state.converged for state in (*test.states, *test.unloaded))
    assert len(test.unloaded) == len(strains) - 1
    of = test.loading.reaction_force
    there, back = ([of(state.gradient) for state in each] for each in (test.states, test.unloaded))
    return np.array(there), np.array(back[::-1]), test


class Hinge:
    """A scalar element in parallel with a spring, stepped without any potential."""

    def __init__(self, friction, k_t):
        self.stiffness = k_t * friction.fold_friction / friction.fold_slide
        self.limit = k_t * friction.fold_friction
        self.hardening = k_t * friction.fold_hardening
        self.moment = self.angle = 0.0

    def trial(self, angle):
        """Moment, limit and energy lost after a turn to an angle."""
        elastic = self.moment + self.stiffness * (angle - self.angle)
        excess = abs(elastic) - self.limit
        if excess <= 0:
            return elastic, self.limit, 0.0
        slip = excess / (self.stiffness + self.hardening)
        limit = self.limit + self.hardening * slip
        return np.sign(elastic) * limit, limit, slip

    def turn(self, angle):
        self.moment, self.limit, _ = self.trial(angle)
        self.angle = angle


def forces_of_three_unknowns(of, strains, friction, steps=10):
    """Forces on a row of a pure stripe across its ridges, by angle and height of its cells [N]."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    hinge, forces, at = Hinge(friction, of.k_t), [], (of.theta_0, cell)
    path = [strains[0]]
    for strain in strains[1:]:
        path += np.linspace(path[-1], strain, steps + 1)[1:].tolist()
    for number, strain in enumerate(path):
        period = of.period * (1 + strain)

        def imbalance(unknowns, period=period):
            theta, height = unknowns
            length = period / (4 * np.sin(theta / 2))
            along, other = cell_forces(of, length, height)
            moment = of.k_t * (theta - of.theta_0) + hinge.trial(theta - of.theta_0)[0]
            return -along * length / (2 * np.tan(theta / 2)) + moment / 2, other

        found = root(imbalance, at, tol=1e-14)
        assert np.abs(imbalance(found.x)).max() < 1e-10
        at = found.x
        hinge.turn(at[0] - of.theta_0)
        if number % steps == 0:
            along, _ = cell_forces(of, period / (4 * np.sin(at[0] / 2)), at[1])
            forces.append(along / np.sin(at[0] / 2))
    return np.array(forces)


@pytest.mark.slow
@DISTINCT_STRIPES
@pytest.mark.parametrize("friction", [PLAIN, HARDENING], ids=["plain", "hardening"])
def test_a_stripe_cycles_as_a_scalar_return_mapping_says(of, friction):
    """Path steps differ, but a turn in one direction slips alike in one step or in many."""
    strains = [0.0, 0.1, 0.2, 0.3]
    there, back, _ = cycled(*pure(of, PERIODIC, ridges="G"), strains, friction)
    expected = 4 * forces_of_three_unknowns(of, [*strains, *strains[-2::-1]], friction)
    np.testing.assert_allclose([*there, *back[::-1]], expected, rtol=1e-6, atol=1e-9)
    assert back[0] < -1e-3 < there[0] + 1e-9


def test_without_friction_nothing_is_lost_and_results_are_those_of_a_plain_test():
    net, fabric = checkered(4, 1, PERIODIC)
    strains = [0.0, 0.05, 0.1]
    there, back, test = cycled(net, fabric, strains, Friction(), cycle=2)
    np.testing.assert_allclose(back, there[:-1], atol=1e-9)
    once = stretch(equations(net, fabric), strains, FINE)
    plain = [once.loading.reaction_force(state.gradient) for state in once.states]
    np.testing.assert_allclose(there, plain, atol=1e-10)
    assert test.loading.length == once.loading.length


@pytest.mark.slow
def test_the_work_of_a_closed_cycle_is_lost_in_the_folds():
    """Without hardening the second cycle is closed; it loses what its folds slip times moments."""
    net, fabric = checkered(4, 1, PERIODIC)
    strains = np.linspace(0, 0.2, 26).tolist()
    there, back, test = cycled(net, fabric, strains, PLAIN, cycle=2)
    assert back[0] == pytest.approx(there[0], abs=2e-4 * there.max())
    closed = np.append(back, there[-1])
    work = (np.trapezoid(there, strains) - np.trapezoid(closed, strains)) * test.loading.length
    passage = Configuration.stacked([each.configuration for each in (*test.states, *test.unloaded)])
    angles, lost = fold_angles(net, fabric, passage).T, 0.0
    for turned, k_t in zip(angles, np.asarray(fabric.fold_stiffness), strict=True):
        hinge = Hinge(PLAIN, float(k_t))
        hinge.angle = turned[0]
        # The first passage begins without the moments of the cycle before, the second with them.
        for number, angle in enumerate([*turned, *turned]):
            if k_t and number >= len(turned):
                lost += hinge.trial(angle)[2] * hinge.limit
            if k_t:
                hinge.turn(angle)
    assert work == pytest.approx(lost, rel=0.02)
    assert work > 0.05 * np.trapezoid(there, strains) * test.loading.length


@pytest.mark.slow
def test_drift_relaxes_the_force_and_leaves_a_set():
    net, fabric = checkered(4, 1, PERIODIC)
    strains = [0.0, 0.1, 0.2]
    drift = Friction(fold_drift=0.1)
    first, back, _ = cycled(net, fabric, strains, drift)
    second, again, _ = cycled(net, fabric, strains, drift, cycle=2)
    np.testing.assert_allclose(second[:-1], back, atol=1e-9)
    assert second[-1] < first[-1]
    assert again[0] < back[0] < 0
    # Half of the drift in the second cycle: 1/c.
    assert (back[0] - again[0]) / (first[0] - back[0]) == pytest.approx(0.5, rel=0.2)


friction_numbers = st.floats(0.01, 0.5)


@given(
    friction_numbers, friction_numbers, st.floats(0, 1), st.lists(st.floats(-1.4, 1.4), min_size=1)
)
def test_elements_follow_the_scalar_mapping_and_lose_energy_only(moment, slide, hardening, angles):
    friction = Friction(moment, slide, hardening)
    element, hinge = FoldFriction.begun(friction, np.ones(1), np.zeros(1)), Hinge(friction, 1.0)
    for angle in angles:
        moments = element.moments(np.array([angle]))
        np.testing.assert_allclose(moments, hinge.trial(angle)[0], atol=1e-12)
        before = float(element.stored(np.array([hinge.angle]))[0])
        step = float(element.stored(np.array([angle]))[0]) - before
        element = element.slipped(np.array([angle]))
        hinge.turn(angle)
        np.testing.assert_allclose(element.moments(np.array([angle])), hinge.moment, atol=1e-12)
        np.testing.assert_allclose(element.moment, hinge.limit, atol=1e-12)
        after = float(element.stored(np.array([angle]))[0])
        assert after - before <= step + 1e-12


@pytest.mark.slow
def test_forces_and_stiffness_with_friction_are_derivatives_of_the_energy():
    net, fabric = checkered(4, 1, PERIODIC)
    slip = 0.3 * np.random.default_rng(3).normal(size=len(fabric.rest_fold))
    fabric = replace(fabric, friction=FoldFriction.begun(HARDENING, fabric.fold_stiffness, slip))
    unknowns = np.asarray(shaken(flat_sheet(net, fabric), 0.1).flattened())

    def total(unknowns):
        return energy(net, fabric, Configuration.of(unknowns, net.shape)).total

    system = equations(net, fabric)
    evaluation = system.evaluate(Point(unknowns))
    assert float(evaluation.energy.total) == pytest.approx(float(total(unknowns)), rel=1e-12)
    slopes = jax.grad(total)(jax.numpy.asarray(unknowns))
    np.testing.assert_allclose(evaluation.gradient, slopes, atol=1e-12)
    free = free_stiffness(net.shape, all_free(net.shape))
    stiffness = symmetric_stiffness(ChunkedFabric(net.shape, fabric), free, unknowns)
    direction = np.random.default_rng(4).normal(size=unknowns.shape)
    step = 1e-7 * direction
    ahead, behind = (
        np.asarray(system.evaluate(Point(at)).gradient) for at in (unknowns + step, unknowns - step)
    )
    np.testing.assert_allclose(stiffness @ direction, (ahead - behind) / 2e-7, rtol=1e-5, atol=1e-6)
