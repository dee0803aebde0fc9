"""Non-linear springs in fabrics: derivatives, tensile tests, dynamics and the zigzag."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from knitlab.model.energy import COMPLETE, energy
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.layout import fabric_layout
from knitlab.model.settings import ModelOptions, Sheet
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe_numbers import StripePair
from knitlab.model.zigzag import tension, zigzag
from knitlab.solvers.dynamics.damped_test import relax_by_dynamics
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.state import Outcome
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads.loading import all_free
from tests.fabrics import (
    CLAMPED,
    FINE,
    PERIODIC,
    SHEET,
    assemble_fabric,
    checkerboard,
    equations,
    moving,
    shaken,
    stretched,
    stripe,
    whole_element_hessians,
)
from tests.solvers.equilibrium.test_adjoint import Pulled, assert_agree, by_differences

CURVE = SpringCurve((0.0, 0.02, 0.05, 0.1, 0.2), (0.0, 1.0, 4.0, 13.0, 40.0))
LAWS = {"stiffening": {"stiffening_strain": 0.1}, "tabulated": {"spring_curve": CURVE}}
EVERY_LAW = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
ENDLESS = ModelOptions(boundary="periodic")
"""Of flat cells, which do not snap here."""
STRAINS = np.linspace(0, 2, 21)


def pair(n_stripe, law):
    return tuple(
        replace(of, **law) for of in (stripe("rib", n_stripe), stripe("garter", 2 * n_stripe))
    )


def lawful(n_stripe, periods, options, law, unit_cells=(1, 1)):
    return assemble_fabric(checkerboard(periods, unit_cells), *pair(n_stripe, law), SHEET, options)


@pytest.mark.slow
@EVERY_LAW
def test_gradient_and_stiffness_are_those_of_differences(law):
    net, fabric = lawful(4, 1, CLAMPED, law)
    at = shaken(flat_sheet(net, fabric), 0.1).flattened()
    free = free_stiffness(net.shape, all_free(net.shape))
    toward = np.random.default_rng(1).normal(size=at.shape)
    toward[np.setdiff1d(np.arange(len(at)), free.dofs)] = 0
    stored = jax.jit(lambda q: energy(net, fabric, Configuration.of(q, net.shape)).total)
    gradient, step = jax.jit(jax.grad(stored)), 1e-6
    slope = (stored(at + step * toward) - stored(at - step * toward)) / (2 * step)
    assert float(gradient(at) @ toward) == pytest.approx(float(slope), rel=1e-7)

    lower = free.lower(free.entries(whole_element_hessians(net, fabric, COMPLETE, at))).toarray()
    matrix = lower + np.tril(lower, -1).T
    slopes = (gradient(at + step * toward) - gradient(at - step * toward)) / (2 * step)
    np.testing.assert_allclose(
        matrix @ toward[free.dofs], np.asarray(slopes)[free.dofs], rtol=1e-6, atol=1e-5
    )


@pytest.mark.slow
@EVERY_LAW
def test_a_tensile_test_does_the_work_that_its_fabric_stores(law):
    """Simpson's rule over the reaction force, while no branch ends."""
    net, fabric = lawful(4, 1, ENDLESS, law)
    strains = np.linspace(0, 0.5, 11)
    test = stretched(net, fabric, strains.tolist(), FINE)
    assert all(state.converged and not state.snapped for state in test.states)
    forces = np.array([test.loading.reaction_force(state.gradient) for state in test.states])
    stored = np.array([float(state.energy.total) for state in test.states])
    step = (strains[1] - strains[0]) * test.loading.length
    works = step / 3 * (forces[:-2:2] + 4 * forces[1:-1:2] + forces[2::2])
    gained = stored[2::2] - stored[:-2:2]
    np.testing.assert_allclose(works, gained, rtol=2e-3, atol=1e-4 * stored[-1])
    linear = stretched(*lawful(4, 1, ENDLESS, {}), [0.0, 0.25, 0.5], FINE)
    assert forces[-1] > 1.2 * linear.loading.reaction_force(linear.states[-1].gradient)


@pytest.mark.slow
@pytest.mark.nightly
@EVERY_LAW
def test_derivatives_are_those_of_differences(law):
    layout = fabric_layout(checkerboard(1), Sheet(6.0, 100.0), ENDLESS)
    stripes = StripePair.of(*([each] for each in pair(4, law)))
    fabric, strain = layout.fabric(stripes), 0.3
    test = stretch(equations(layout.net, fabric), [0, 0.1, 0.2, strain], FINE)
    relaxed, *_, strained = (state.configuration for state in test.states)
    of = Pulled(layout, (1, 1), stripes, strain, relaxed, strained)
    assert_agree(of.sensitivities(), by_differences(of))
    if "stiffening_strain" not in law:
        return
    found = of.adjoint().strained_derivatives(strain, strained, of.measure)
    for side in ("weft", "warp"):

        def where(stripes, side=side):
            return getattr(stripes, side).stiffening_strain

        def at(factor, where=where):
            return of.measured(eqx.tree_at(where, stripes, factor * where(stripes)))

        differences = (at(1.001) - at(0.999)) / (0.002 * float(where(stripes)))
        np.testing.assert_allclose(where(found), differences, rtol=1e-4, atol=1e-8)


@pytest.mark.slow
@pytest.mark.nightly
@EVERY_LAW
def test_energy_and_dissipation_balance_over_a_motion(law):
    settings = Dynamics(step_safety=0.1, damping_ratio=0.1, release=0.0)
    net, fabric = lawful(8, 1, PERIODIC, law)
    fabrics = replace(moving([(8, 1)], PERIODIC, settings), fabrics=[fabric])
    # From a sheet stretched by a tenth, where the law matters.
    sheet = flat_sheet(net, fabric)
    start = Configuration(sheet.positions * 1.1, sheet.lengths * 1.1)
    (relaxed,) = relax_by_dynamics(fabrics, sheets=[start])
    history = relaxed.history
    total = history.kinetic + history.potential + history.dissipated
    stored = energy(net, fabric, start)
    assert float(history.potential[0]) == pytest.approx(float(stored.total), rel=1e-9)
    linear = energy(*lawful(8, 1, PERIODIC, {}), start)
    assert float(stored.stretch) > 1.4 * float(linear.stretch)
    assert relaxed.outcome is Outcome.converged
    assert np.ptp(total) < 2e-3 * history.potential[0]
    assert (np.diff(history.dissipated) >= 0).all()


@pytest.mark.slow
@EVERY_LAW
@pytest.mark.parametrize(("knit", "n"), [("rib", 4), ("garter", 16)])
def test_the_zigzag_meets_its_two_balances(law, knit, n):
    """θ from the strain of the spring, for a sweep of it: the period and force follow in closed
    form but for the root of the moment's balance, found here by another method."""
    of = replace(stripe(knit, n), **law)
    chain = zigzag(of)
    cell = of.period / (4 * np.sin(of.theta_0 / 2))
    strain, force = [], []
    for stretched_by in np.linspace(0.002, 0.12, 13):
        length = cell * (1 + stretched_by)
        pull = of.k_s * float(chain.law.pull(jnp.asarray(length), jnp.asarray(cell)))

        def moment(tilt, pull=pull, length=length):
            turned = of.k_t * (np.pi - 2 * tilt - of.theta_0)
            return turned - pull / np.cos(tilt) * length * np.sin(tilt)

        tilt = brentq(moment, 1e-12, np.pi / 2 - of.theta_0 / 2, xtol=1e-15)
        strain.append(4 * length * np.cos(tilt) / of.period - 1)
        force.append(pull / np.cos(tilt))
    np.testing.assert_allclose(tension(chain, jnp.array(strain)), force, rtol=1e-8)
