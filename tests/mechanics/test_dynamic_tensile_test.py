"""Dynamics and the equilibrium solver reach the same states."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from knitlab.measure.cell_grid import CellGrid
from knitlab.measure.corners import unit_cell_corners
from knitlab.measure.strain import central_mean, local_strain, poisson_ratio
from knitlab.mechanics.dynamic_tensile_test import MotionPath, move, stretch_by_dynamics
from knitlab.mechanics.dynamics_settings import DynamicsSettings
from knitlab.mechanics.loading import rigidly_aligned, tensile
from knitlab.model.configuration import Configuration
from knitlab.model.energy import energy
from knitlab.model.fabric import flat_sheet
from knitlab.model.network import network
from knitlab.solvers.state import Outcome
from tests.fabrics import CLAMPED, PERIODIC, checkered, moving, relaxed, shaken, stretched

SETTINGS = DynamicsSettings()
STRAINS = [0.0, 0.05, 0.1, 0.15, 0.2]
PATCHES = (2, 2)
"""Corners of a single unit cell; between clamps only those of its patches can move across."""


def patch_poisson_ratio(shape, test):
    configurations = Configuration.stacked([state.configuration for state in test.states])
    corners = unit_cell_corners(shape, CellGrid.even(shape, PATCHES), configurations)
    strain_xx, strain_yy = local_strain(corners[0], corners)
    return np.asarray(poisson_ratio(central_mean(strain_xx), central_mean(strain_yy)))[1:]


@pytest.mark.slow
@pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])
def test_both_methods_reach_the_same_states(options):
    net, fabric = checkered(4, 2, options)
    in_equilibrium = stretched(net, fabric, STRAINS)
    batch = moving([(4, 2)], options, SETTINGS)
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
    # Both snap: the dynamics at a reduced rate, the solver at the end of its branch. Then they
    # find the same states. Where the dynamics lose work, the solver finds the end of a branch. It
    # also detects smaller snaps, because its steps are smaller.
    flagged = np.array(
        [[state.snapped for state in test.states] for test in (in_equilibrium, by_dynamics)]
    )
    assert flagged[0].any()
    assert flagged[1].any() == (options is PERIODIC)
    assert not (flagged[1] & ~flagged[0]).any()
    np.testing.assert_allclose(energies[1], energies[0], rtol=1e-4)
    np.testing.assert_allclose(ratios[1], ratios[0], rtol=0.01, atol=1e-4)


def loss_of_a_pull(design, rate):
    """Work and losses when periodic fabric is stretched from rest to 5 % strain at one rate."""
    batch = moving([design], PERIODIC, SETTINGS)
    net = network(batch.shape)
    relaxed_state = relaxed(net, batch.fabrics[0])
    loading = tensile(batch.shape, relaxed_state.configuration)
    path = MotionPath(relaxed_state.unknowns, loading, after=0.05, rate=rate)
    (result,) = move(batch, [path])
    rise = float(result.state.energy.total - relaxed_state.energy.total)
    return result, rise


@pytest.mark.slow
def test_the_loss_is_the_work_that_did_not_go_into_the_fabric():
    loss = []
    for rate in (1.0, 0.1, 0.025):
        result, rise = loss_of_a_pull((8, 1), rate)
        dissipated = result.history.dissipated[-1]
        work = rise + dissipated
        # Fast tests overshoot, and the drive recovers part of its work.
        assert result.loss == pytest.approx(
            (dissipated + result.state.kinetic_peak) / work, rel=0.05
        )
        loss.append(result.loss)
    assert loss[0] > 0.3
    assert loss[1] / loss[2] > 3  # the work of the drag is proportional to the rate
    assert loss[2] < SETTINGS.quasi_static_limit


@pytest.mark.slow
def test_too_fast_a_test_is_reported_and_is_no_snap():
    fast = replace(SETTINGS, ramp_rate=20.0, smallest_rate=1 / 16)
    (test,) = stretch_by_dynamics(moving([(8, 1)], PERIODIC, fast), [[0.0, 0.05, 0.1]])
    assert [state.outcome for state in test.states] == [Outcome.converged, Outcome.too_fast]
    assert not test.states[-1].snapped


@pytest.mark.slow
def test_a_whole_test_runs_with_the_papers_fixed_steps():
    fixed = replace(SETTINGS, ending="fixed_steps")
    (test,) = stretch_by_dynamics(moving([(4, 1)], PERIODIC, fixed), [[0.0, 0.1, 0.2]])
    (steady,) = stretch_by_dynamics(moving([(4, 1)], PERIODIC, SETTINGS), [[0.0, 0.1, 0.2]])
    assert test.states[0].residual > 1e-7
    for state, rest in zip(test.states, steady.states, strict=True):
        assert state.converged
        assert state.residual < 1e-3
        assert float(state.energy.total) == pytest.approx(float(rest.energy.total), rel=1e-5)


@pytest.mark.slow
def test_a_test_that_ends_does_not_end_others_of_its_batch():
    batch = moving(
        [(4, 1), (8, 1)], PERIODIC, replace(SETTINGS, ramp_rate=0.2, quasi_static_limit=10.0)
    )
    reported = []
    strains = [0.0, 0.05]
    tests = stretch_by_dynamics(
        batch, [[0.0, np.nan], strains], lambda case, done: reported.append((case, done))
    )
    assert len(tests[0].states) == 2
    assert not tests[0].states[-1].converged
    assert [state.converged for state in tests[1].states] == [True] * 2
    alone = moving([(8, 1)], PERIODIC, batch.settings)
    (honest,) = stretch_by_dynamics(alone, [strains])
    assert float(tests[1].states[-1].energy.total) == pytest.approx(
        float(honest.states[-1].energy.total), rel=1e-5
    )
    assert reported == [(0, 1), (1, 1), (0, 2), (1, 2)]


@pytest.mark.slow
@given(turn=arrays(float, 3, elements=st.floats(-3, 3)))
def test_a_sample_is_aligned_after_any_rotation(turn):
    net, fabric = checkered(4, 1, CLAMPED)
    flat = flat_sheet(net, fabric)
    shape = shaken(flat, 0.05)
    turned = Rotation.from_rotvec(turn).apply(np.array(shape.positions).reshape(-1, 3))
    nodes = np.array([3, -2, 1]) + turned.reshape(shape.positions.shape)
    skewed = Configuration(nodes, shape.lengths)
    square = rigidly_aligned(net.shape, flat, shape)
    again = rigidly_aligned(net.shape, flat, skewed)
    for axis in (0, 1):
        np.testing.assert_allclose(
            np.diff(again.positions, axis=axis), np.diff(square.positions, axis=axis), atol=1e-12
        )
    rows = np.asarray(square.positions)[[0, -1]].mean(axis=1)
    assert rows[0, 2] == pytest.approx(rows[1, 2])
    assert float(energy(net, fabric, again).stretch) == pytest.approx(
        float(energy(net, fabric, shape).stretch)
    )
