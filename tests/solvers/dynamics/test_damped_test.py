"""Relaxation and tensile test by dynamics: against equilibria, closed forms and balances."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.energy import energy
from knitlab.model.fabric import flat_sheet
from knitlab.model.inertia import Inertia, inertia
from knitlab.model.network import network
from knitlab.model.settings import ModelOptions
from knitlab.solvers.dynamics.damped_test import (
    MovingFabrics,
    relax_by_dynamics,
    stretch_by_dynamics,
)
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.state import Outcome
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.shear import Shear
from knitlab.solvers.loads.weft import Weft
from tests.fabrics import (
    CLAMPED,
    DISTINCT_STRIPES,
    FINE,
    PERIODIC,
    checkered,
    equations,
    moving,
    periodic_poisson_ratio,
    pure,
    shaken,
    stretched,
)

SETTINGS = Dynamics(damping_ratio=0.1, release=0.0)
"""With more damping than usual, which shortens the way to rest."""
AT_REST = replace(SETTINGS, rest_force=1e-9, longest_time=4000.0)
ENDLESS = ModelOptions(boundary="periodic")
"""Of flat cells, which do not snap here."""
STRAINS = [0.0, 0.05, 0.1]


def of_pure(of, options, settings):
    net, fabric = pure(of, options)
    own = inertia([of], [of], options, settings.surface_density, settings.damping_ratio)
    return MovingFabrics(net.shape, [fabric], [own], settings, [WARP])


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("integrator", ["leapfrog", "tsit5"])
def test_both_methods_reach_the_same_states(integrator):
    net, fabric = checkered(4, 1, ENDLESS)
    in_equilibrium = stretched(net, fabric, STRAINS, FINE)
    # Tsit5 errs by its tolerance in every step, and so trembles with a force of about 1e-7 N.
    force = 1e-9 if integrator == "leapfrog" else 1e-6
    settings = replace(AT_REST, integrator=integrator, rest_force=force)
    (by_dynamics,) = stretch_by_dynamics(moving([(4, 1)], ENDLESS, settings), [STRAINS])
    for test in (in_equilibrium, by_dynamics):
        assert [state.outcome for state in test.states] == [Outcome.converged] * len(STRAINS)
    for one, other in zip(by_dynamics.states, in_equilibrium.states, strict=True):
        assert one.residual <= force
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-8)
        stored = energy(net, fabric, one.configuration)
        assert float(one.energy.total) == pytest.approx(float(stored.total), rel=1e-12)
    ratios = periodic_poisson_ratio(by_dynamics), periodic_poisson_ratio(in_equilibrium)
    np.testing.assert_allclose(*ratios, rtol=0, atol=1e-5)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("options", "load"),
    [
        (ENDLESS, Weft()),
        (ENDLESS, Biaxial(ratio=0.5)),
        (CLAMPED, Weft()),
        (CLAMPED, Biaxial(ratio=0.5)),
        (CLAMPED, Shear()),
    ],
)
def test_other_loads_lead_to_the_equilibria_too(options, load):
    strains = [0.0, 0.02]
    (by_dynamics,) = stretch_by_dynamics(moving([(4, 1)], options, AT_REST, load=load), [strains])
    folded = by_dynamics.states[0].configuration
    net, fabric = checkered(4, 1, options)
    expected = stretch(equations(net, fabric), strains, FINE, folded=folded, load=load)
    for one, other in zip(by_dynamics.states, expected.states, strict=True):
        assert one.outcome is other.outcome is Outcome.converged
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-8)
        force, other_force = (
            [test.loading.reaction_force(state.gradient), *along(test, state)]
            for test, state in ((by_dynamics, one), (expected, other))
        )
        np.testing.assert_allclose(force, other_force, atol=1e-6)


def along(test, state):
    """Forces along both axes, under a biaxial load [N]."""
    if test.loading.load.kind != "biaxial":
        return []
    return [test.loading.force_along(axis, state.gradient) for axis in (0, 1)]


@pytest.mark.slow
@DISTINCT_STRIPES
def test_a_pure_stripe_relaxes_to_its_rest_angle(of):
    """Every fold has θ0 then, and a period is sin(θ0/2) of what it is flat."""
    fabrics = of_pure(of, PERIODIC, AT_REST)
    (relaxed,) = relax_by_dynamics(fabrics)
    assert relaxed.outcome is Outcome.converged
    flat = flat_sheet(network(fabrics.shape), fabrics.fabrics[0])
    across, along = (0, 1) if of.knit == "rib" else (1, 0)
    parts = np.asarray(relaxed.configuration.lengths) / np.asarray(flat.lengths)
    assert parts[across] == pytest.approx(np.sin(of.theta_0 / 2), rel=1e-7)
    assert parts[along] == pytest.approx(1, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])
def test_the_history_of_a_relaxation_balances(options):
    settings = replace(SETTINGS, snapshots=30, step_safety=0.2, release=0.0)
    fabrics = moving([(8, 1)], options, settings)
    (relaxed,) = relax_by_dynamics(fabrics)
    history = relaxed.history
    total = history.kinetic + history.potential + history.dissipated
    assert relaxed.outcome is Outcome.converged
    assert history.kinetic.max() > 0.01 * history.potential[0]
    assert history.kinetic[-1] < 1e-6 * history.potential[0]
    assert history.force_left < 1e-4
    assert np.ptp(total) < 1e-3 * history.potential[0]
    assert (np.diff(history.dissipated) >= 0).all()
    assert (np.diff(history.time) > 0).all()
    np.testing.assert_array_equal(history.snapshot_time, history.time)
    net, (fabric,) = network(fabrics.shape), fabrics.fabrics
    first = flat_sheet(net, fabric)
    np.testing.assert_allclose(history.snapshots.positions[0], first.positions, atol=1e-12)
    for place in (0, 5, -1):
        at = type(first)(history.snapshots.positions[place], history.snapshots.lengths[place])
        stored = float(energy(net, fabric, at).total)
        assert stored == pytest.approx(history.potential[place], rel=1e-9)


@pytest.mark.slow
def test_a_given_sheet_is_released_in_place_of_the_flat_one():
    fabrics = moving([(8, 1)], PERIODIC, replace(SETTINGS, ending="time", relax_time=0.02))
    net, (fabric,) = network(fabrics.shape), fabrics.fabrics
    sheet = shaken(flat_sheet(net, fabric), 0.05)
    (relaxed,) = relax_by_dynamics(fabrics, sheets=[sheet])
    stored = float(energy(net, fabric, sheet).total)
    assert relaxed.history.potential[0] == pytest.approx(stored, rel=1e-12)
    assert relaxed.history.time[-1] == pytest.approx(0.02)


@pytest.mark.slow
def test_a_test_for_a_time_passes_through_its_strains_without_a_pause():
    settings = replace(SETTINGS, ending="time", relax_time=5.0, strain_rate=0.05)
    (test,) = stretch_by_dynamics(moving([(4, 1)], CLAMPED, settings), [STRAINS])
    assert all(state.converged for state in test.states)
    assert test.history.time[-1] == pytest.approx(5.0)
    rows = [np.asarray(state.configuration.positions)[[0, -1]] for state in test.states]
    for strain, (bottom, top) in zip(STRAINS, rows, strict=True):
        np.testing.assert_allclose(bottom, rows[0][0], atol=1e-12)
        pulled = np.array([0, strain * test.loading.length, 0])
        np.testing.assert_allclose(top, rows[0][1] + pulled, atol=1e-9)
    # Its states are not equilibria; the slower it is, the nearer they are to them.
    slow = replace(settings, strain_rate=0.005)
    (slower,) = stretch_by_dynamics(moving([(4, 1)], CLAMPED, slow), [STRAINS])
    assert slower.states[-1].residual < test.states[-1].residual / 3
    assert slower.states[-1].kinetic_peak < test.states[-1].kinetic_peak


@pytest.mark.slow
def test_the_slower_a_test_the_closer_it_is_to_equilibria():
    settings = replace(SETTINGS, ending="time", relax_time=40.0)
    expected = periodic_poisson_ratio(stretched(*checkered(4, 1, ENDLESS), STRAINS, FINE))
    errors = []
    for rate in (0.1, 0.01, 0.001):
        fabrics = moving([(4, 1)], ENDLESS, replace(settings, strain_rate=rate))
        (test,) = stretch_by_dynamics(fabrics, [STRAINS])
        errors.append(np.abs(periodic_poisson_ratio(test) - expected).max())
    # The lag of a damped motion is proportional to its rate.
    assert errors[0] > 3 * errors[1]
    assert errors[1] > 3 * errors[2]
    assert errors[2] < 1e-2


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({"longest_time": 0.1}, Outcome.time_limit),
        ({"ending": "time", "relax_time": 0.1}, Outcome.converged),
    ],
)
def test_the_end_of_a_relaxation_is_reported(changes, outcome):
    (relaxed,) = relax_by_dynamics(moving([(8, 1)], PERIODIC, replace(SETTINGS, **changes)))
    assert relaxed.outcome is outcome
    assert relaxed.history.time[-1] == pytest.approx(0.1)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_fabric_that_diverges_does_not_affect_others_of_its_batch():
    settings = replace(SETTINGS, ending="time", relax_time=0.5, strain_rate=0.2)
    fabrics = moving([(4, 1), (8, 1)], PERIODIC, settings)
    reported = []
    strains = [[0.0, 0.02, 0.04]] * 2
    honest = stretch_by_dynamics(fabrics, strains)
    spoiling = Inertia(fabrics.inertias[0].node_mass, jnp.array(np.nan))
    spoiled = stretch_by_dynamics(
        replace(fabrics, inertias=[spoiling, fabrics.inertias[1]]),
        strains,
        lambda case, states: reported.append((case, states)),
    )
    assert [state.outcome for state in spoiled[0].states] == [Outcome.diverged]
    assert spoiled[0].loading is None
    assert [state.outcome for state in spoiled[1].states] == [Outcome.converged] * 3
    for one, other in zip(spoiled[1].states, honest[1].states, strict=True):
        np.testing.assert_allclose(one.unknowns, other.unknowns, atol=1e-9)
    assert [case for case, states in reported if states > 1] == [1, 1]
