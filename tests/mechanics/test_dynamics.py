"""Damped dynamics: against closed forms, its own balance of energy, and smaller steps."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.mechanics.dynamic_tensile_test import MotionPath, MovingBatch, move
from knitlab.mechanics.dynamics_settings import DynamicsSettings
from knitlab.model.configuration import Configuration
from knitlab.model.energy import energy
from knitlab.model.fabric import Fabric, flat_sheet
from knitlab.model.inertia import Inertia, moved_mass
from knitlab.model.network import MeshShape, network
from knitlab.solvers.state import Outcome
from tests.fabrics import CLAMPED, PERIODIC, checkered, moving, relaxed

SETTINGS = DynamicsSettings()
STIFFNESS, MASS, LENGTH, PULL = 2.0, 1e-3, 1.0, 1e-3


def two_nodes(damping: float, settings: DynamicsSettings) -> tuple[MovingBatch, MotionPath]:
    """One spring along x between two free nodes, released with the elongation ``PULL``."""
    shape = MeshShape(cells_y=0, cells_x=1, periodic=False)
    none = jnp.zeros(0)
    fabric = Fabric(
        rest_length=jnp.array([LENGTH]),
        stretch_stiffness=jnp.array([STIFFNESS]),
        rest_fold=none,
        fold_stiffness=none,
        z_max=jnp.array(6.0),
        k_wall=jnp.array(100.0),
        cell_x=jnp.array([LENGTH]),
        cell_y=jnp.zeros(0),
        fold_angle="whole_normals",
    )
    inertia = Inertia(jnp.array(MASS), jnp.array(damping))
    start = np.array([0, 0, 0, LENGTH + PULL, 0, 0, 0, 0])
    return MovingBatch(shape, [fabric], [inertia], settings), MotionPath(start)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_two_nodes_on_a_spring_vibrate_at_their_frequency(damping):
    settings = replace(SETTINGS, duration=1.0, relative_tolerance=1e-9)
    batch, path = two_nodes(damping, settings)
    (result,) = move(batch, [path])
    time = result.history.snapshot_time
    x = result.history.snapshots.positions[:, 0, :, 0]
    stretch = x[:, 1] - x[:, 0] - LENGTH
    decay = damping / (2 * MASS)
    frequency = np.sqrt(2 * STIFFNESS / MASS - decay**2)
    swing = np.cos(frequency * time) + decay / frequency * np.sin(frequency * time)
    assert time[-1] == pytest.approx(1.0)
    assert frequency * time[-1] > 60
    np.testing.assert_allclose(stretch, PULL * np.exp(-decay * time) * swing, atol=1e-5 * PULL)


@pytest.mark.slow
def test_an_undamped_spring_never_comes_to_rest():
    batch, path = two_nodes(0.0, replace(SETTINGS, duration=1.0))
    (result,) = move(batch, [path])
    assert result.state.outcome is Outcome.time_limit
    assert result.state.kinetic_peak == pytest.approx(0.5 * STIFFNESS * PULL**2, rel=1e-2)


@pytest.mark.slow
def test_energy_and_dissipation_balance_over_a_relaxation():
    batch = moving([(8, 1)], PERIODIC, SETTINGS)
    sheet = np.asarray(flat_sheet(network(batch.shape), batch.fabrics[0]).flattened())
    (result,) = move(batch, [MotionPath(sheet)])
    history = result.history
    total = history.kinetic + history.potential + history.dissipated
    assert result.state.converged
    assert history.kinetic.max() > 0.1 * history.potential[0]
    assert history.kinetic[-1] < 1e-9 * history.potential[0]
    assert np.ptp(total) < 1e-4 * history.potential[0]
    assert (np.diff(history.dissipated) >= 0).all()


@pytest.mark.slow
def test_the_error_falls_with_the_fifth_power_of_the_time_step():
    ends = []
    for steps in (60, 120, 480):
        settings = replace(
            SETTINGS, ending="fixed_steps", fixed_steps=steps, time_step=0.06 / steps
        )
        batch = moving([(8, 1)], CLAMPED, settings)
        sheet = flat_sheet(network(batch.shape), batch.fabrics[0]).flattened()
        (result,) = move(batch, [MotionPath(np.asarray(sheet))])
        assert result.state.iterations == steps
        ends.append(result.state.unknowns)
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 4.5).all(), (errors, orders)


@pytest.mark.slow
def test_the_error_falls_with_the_tolerance():
    ends = []
    for tolerance in (1e-4, 1e-6, 1e-9):
        settings = replace(
            SETTINGS, duration=0.1, relative_tolerance=tolerance, absolute_tolerance=tolerance / 1e3
        )
        batch = moving([(8, 1)], CLAMPED, settings)
        sheet = flat_sheet(network(batch.shape), batch.fabrics[0]).flattened()
        (result,) = move(batch, [MotionPath(np.asarray(sheet))])
        ends.append(result.state.unknowns)
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    assert errors[0] > 10 * errors[1], errors


@pytest.mark.slow
def test_damping_is_near_critical_for_the_softest_mode():
    net, fabric = checkered(4, 2, PERIODIC)
    state = relaxed(net, fabric)
    (inertia,) = moving([(4, 2)], PERIODIC, SETTINGS).inertias
    mass = np.asarray(moved_mass(net.shape, inertia).flattened())
    hessian = jax.jit(
        jax.hessian(lambda q: energy(net, fabric, Configuration.of(q, net.shape)).total)
    )
    stiffness = np.asarray(hessian(jnp.asarray(state.unknowns)))
    squares = np.linalg.eigvalsh(stiffness / np.sqrt(mass[:, None] * mass))
    assert np.abs(squares[:3]).max() < 1e-6 * squares[3]  # translations
    softest = np.sqrt(squares[3])
    assert 0.5 < float(inertia.damping / inertia.node_mass) / (2 * softest) < 1.5


@pytest.mark.slow
def test_a_batch_moves_like_each_of_its_cases_alone():
    batch = moving([(2, 1), (8, 1)], PERIODIC, SETTINGS)
    flat = [flat_sheet(network(batch.shape), fabric) for fabric in batch.fabrics]
    sheets = [np.asarray(sheet.flattened()) for sheet in flat]
    together = move(batch, [MotionPath(sheet) for sheet in sheets])
    for case, sheet in enumerate(sheets):
        one = replace(
            batch, fabrics=batch.fabrics[case : case + 1], inertias=batch.inertias[case : case + 1]
        )
        (alone,) = move(one, [MotionPath(sheet)])
        assert together[case].state.outcome is alone.state.outcome is Outcome.converged
        assert float(together[case].state.energy.total) == pytest.approx(
            float(alone.state.energy.total), rel=1e-6
        )
        np.testing.assert_allclose(
            together[case].state.configuration.lengths,
            alone.state.configuration.lengths,
            rtol=1e-4,
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ending", "outcome"), [("steady", Outcome.stalled), ("fixed_steps", Outcome.diverged)]
)
def test_a_design_that_diverges_does_not_affect_others_of_its_batch(ending, outcome):
    settings = replace(SETTINGS, ending=ending)
    batch = moving([(4, 1), (8, 1)], PERIODIC, settings)
    flat = [flat_sheet(network(batch.shape), fabric) for fabric in batch.fabrics]
    sheets = [np.asarray(sheet.flattened()) for sheet in flat]
    honest = move(batch, [MotionPath(sheet) for sheet in sheets])
    # With a much too small mass fixed steps diverge, with a mass of NaN all methods do.
    mass = jnp.array(1e-12 if ending == "fixed_steps" else np.nan)
    light = Inertia(mass, batch.inertias[0].damping)
    spoiled = move(
        replace(batch, inertias=[light, batch.inertias[1]]), [MotionPath(sheet) for sheet in sheets]
    )
    assert spoiled[0].state.outcome is outcome
    assert spoiled[1].state.outcome is honest[1].state.outcome
    np.testing.assert_allclose(spoiled[1].state.unknowns, honest[1].state.unknowns, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({"max_steps": 50}, Outcome.iteration_limit),
        ({"duration": 0.1}, Outcome.time_limit),
        pytest.param(
            {"ending": "fixed_steps", "fixed_steps": 100},
            Outcome.time_limit,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"ending": "fixed_steps", "fixed_steps": 100, "fixed_steps_force": 10.0},
            Outcome.converged,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_end_of_a_motion_is_reported(changes, outcome):
    batch = moving([(8, 1)], PERIODIC, replace(SETTINGS, **changes))
    sheet = np.asarray(flat_sheet(network(batch.shape), batch.fabrics[0]).flattened())
    (result,) = move(batch, [MotionPath(sheet)])
    assert result.state.outcome is outcome
    assert np.isfinite(result.state.residual)
    assert (result.state.residual <= batch.settings.force_left) == result.state.converged
