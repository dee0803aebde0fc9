"""The tensile test: balance of forces, work, symmetry, model options, and reported failures."""

from dataclasses import replace

import numpy as np
import pytest

from knitlab.model.fabric import Configuration
from knitlab.solvers.equilibrium import strain_path
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import Outcome
from knitlab.solvers.equilibrium.tensile_test import stretch
from tests.fabrics import (
    CLAMPED,
    FINE,
    PERIODIC,
    checkered,
    equations,
    patch_map,
    patterned,
    relaxed,
    stretched,
)


@pytest.mark.slow
def test_reactions_at_top_and_bottom_cancel():
    net, fabric = checkered(4, 1, CLAMPED, unit_cells=(2, 1))
    test = stretched(net, fabric, [0.0, 0.1, 0.2], FINE)
    for state in test.states:
        forces = Configuration.of(state.gradient, net.shape).positions
        assert np.abs(forces[0].sum(axis=0) + forces[-1].sum(axis=0)).max() < 1e-7
        top = forces[-1, :, 1].sum()
        assert test.loading.reaction_force(state.gradient) == pytest.approx(top, abs=1e-12)
    assert top > 1e-3


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(CLAMPED, id="clamped", marks=pytest.mark.slow),
        pytest.param(PERIODIC, id="periodic"),
    ],
)
def test_the_reaction_force_does_the_work_that_the_energy_gains(options):
    net, fabric = checkered(2, 1, options)
    # Gauss–Legendre points between two strains integrate the smooth force to high order.
    points, weights = np.polynomial.legendre.leggauss(5)
    strains = [0.0, *(0.1 * (points + 1) / 2), 0.1]
    test = stretched(net, fabric, strains, FINE)
    forces = [test.loading.reaction_force(state.gradient) for state in test.states]
    work = test.loading.length * 0.1 * (weights @ forces[1:-1]) / 2
    gained = float(test.states[-1].energy.total - test.states[0].energy.total)
    assert work == pytest.approx(gained, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    "flip",
    [
        pytest.param(np.fliplr, id="in x"),
        pytest.param(np.flipud, id="in y", marks=pytest.mark.slow),
    ],
)
def test_mirrored_patterns_make_mirrored_shapes(flip):
    pattern = patch_map(["RGG", "GRG"], 1)
    net, fabric = patterned(4, pattern, CLAMPED)
    _, mirrored = patterned(4, replace(pattern, knit=flip(pattern.knit)), CLAMPED)
    one, other = (relaxed(net, these, FINE) for these in (fabric, mirrored))
    assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-10)
    axis = 0 if flip is np.fliplr else 1
    nodes = flip(one.configuration.positions).copy()
    nodes[..., axis] *= -1
    expected = other.configuration.positions
    offset = (expected - nodes).mean(axis=(0, 1))
    assert np.abs(nodes + offset - expected).max() < 1e-6


@pytest.mark.slow
@pytest.mark.nightly
def test_the_curve_does_not_depend_on_the_recorded_strains():
    net, fabric = checkered(4, 2, PERIODIC)
    coarse = stretched(net, fabric, [0.0, 0.08, 0.16])
    fine = stretched(net, fabric, [0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16])
    # 0.1 and 0.11 lie on either side of a snap.
    for one, other in zip(coarse.states, fine.states[::4], strict=True):
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-6)


def test_a_fabric_that_does_not_relax_is_reported():
    net, fabric = checkered(4, 1, PERIODIC)
    test = stretched(net, fabric, [0.0, 0.1], Solver(max_iterations=2))
    assert test.loading is None
    assert [state.outcome for state in test.states] == [Outcome.iteration_limit]
    assert test.states[0].residual > 1e-8


@pytest.mark.slow
def test_a_step_that_fails_is_halved(monkeypatch):
    monkeypatch.setattr(strain_path, "ROUGH", np.inf)  # so that a step is one search
    net, fabric = checkered(4, 1, PERIODIC)
    whole = Solver(path_step=1.0, ramp_steps=60, branch_limit=1e9)
    iterations = stretched(net, fabric, [0.0, 0.4], whole).states[1].iterations
    # Too few iterations for the whole step, enough for a half or a quarter of it.
    tight = replace(whole, max_iterations=iterations - 1)
    halved = stretched(net, fabric, [0.0, 0.4], tight)
    assert halved.states[1].converged
    assert halved.states[1].iterations > iterations
    given_up = stretched(net, fabric, [0.0, 0.4, 0.5], replace(tight, smallest_step=1.0))
    assert [state.converged for state in given_up.states] == [True, False]


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(PERIODIC, id="periodic"),
        pytest.param(CLAMPED, id="clamped", marks=pytest.mark.slow),
    ],
)
def test_a_rough_step_ends_where_a_smooth_one_does(options, monkeypatch):
    """Soft walls and a convexified stiffness do not change the state that is found."""
    net, fabric = checkered(4, 1, options)
    ways = []
    for iterations in (-1, np.inf):
        monkeypatch.setattr(strain_path, "ROUGH", iterations)
        ways.append(stretched(net, fabric, [0.0, 0.01, 0.02, 0.03]).states)
    for rough, smooth in zip(*ways, strict=True):
        assert rough.converged
        assert not rough.snapped
        assert float(rough.energy.total) == pytest.approx(float(smooth.energy.total), rel=1e-8)
    assert [state.iterations for state in ways[0]] != [state.iterations for state in ways[1]]


def test_unloading_returns_through_the_states_of_loading():
    strains = 0.0, 0.02, 0.04, 0.06
    net, fabric = checkered(4, 1, PERIODIC)
    test = stretch(equations(net, fabric), strains, FINE, unload=True)
    assert len(test.unloaded) == len(strains) - 1
    for up, back in zip(test.states[-2::-1], test.unloaded, strict=True):
        assert back.converged
        assert not back.snapped
        # A translation of periodic fabric costs nothing.
        shapes = (state.configuration.positions for state in (back, up))
        centred = (shape - shape.mean(axis=(0, 1)) for shape in shapes)
        np.testing.assert_allclose(*centred, atol=1e-7)
        np.testing.assert_allclose(back.configuration.lengths, up.configuration.lengths, rtol=1e-9)
