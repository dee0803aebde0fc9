"""Folds on the paper's grid, and rounded ridges on finer ones."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.model.fold_lines import Ridge, fold_senses, fold_stiffness_factors
from knitlab.model.settings import ModelOptions
from tests.fabrics import DISTINCT_STRIPES, FINE, patch_map, pure, relaxed

FINER = st.sampled_from([8, 16])
FRACTIONS = st.floats(0.05, 1.0)
PHASES = st.sampled_from(["stripe_border", "stripe_centre"])


def test_on_the_papers_grid_a_fold_is_one_hinge_whatever_the_ridge():
    for fraction in (0.1, 0.5, 1.0):
        ridge = Ridge(4, fraction)
        assert ridge.fold_shares.tolist() == [0, 1, 0]
        assert (ridge.stiffness_by_position("stripe_border") == 1).all()
        assert float(ridge.rest_fold(jnp.array(0.77))) == np.pi - 0.77


@given(FINER, FRACTIONS, PHASES)
def test_a_stripe_has_the_same_compliance_and_the_same_folds_on_any_grid(cells, fraction, phase):
    ridge = Ridge(cells, fraction)
    refinement = cells // 4
    # On a refined grid there are more, but shorter edges.
    compliance = (1 / (refinement * ridge.stiffness_by_position(phase))).sum()
    assert compliance == pytest.approx(4)
    assert ridge.fold_shares.sum() == pytest.approx(1)
    parts = fold_senses(np.ones((1, 2 * cells), bool), phase, periodic=True, ridge=ridge)[0]
    assert parts.sum() == pytest.approx(0, abs=1e-12)
    # Adjacent ridges cancel on the line between them.
    assert np.abs(parts).sum() <= 4 + 1e-12
    if fraction < 1 - 1 / (2 * refinement):
        assert np.abs(parts).sum() == pytest.approx(4)


@pytest.mark.slow
@settings(max_examples=20)
@given(FINER, FRACTIONS, st.floats(0.3, 3.0))
def test_the_angle_of_a_ridge_keeps_the_relaxed_length(cells, fraction, theta_0):
    ridge = Ridge(cells, fraction)
    turn = float(ridge.rest_fold(jnp.array(theta_0)))
    senses = fold_senses(np.ones((1, cells), bool), "stripe_border", True, ridge)[0]
    # Walk along one period, turning at every line.
    heading = np.cumsum(senses * turn)
    length = np.cos(heading - heading.mean()).mean()
    assert length == pytest.approx(np.sin(theta_0 / 2), abs=1e-9)


def test_the_angle_of_a_ridge_is_differentiable_by_the_rest_angle():
    ridge = Ridge(8, 0.5)
    turn, step = lambda theta: ridge.rest_fold(jnp.asarray(theta)), 1e-6
    expected = (turn(0.77 + step) - turn(0.77 - step)) / (2 * step)
    assert float(jax.grad(turn)(0.77)) == pytest.approx(float(expected), rel=1e-6)


@pytest.mark.slow
@DISTINCT_STRIPES
@pytest.mark.parametrize("cells_per_period", [8, 16])
def test_a_pure_stripe_relaxes_without_energy_to_the_same_length_on_finer_grids(
    of, cells_per_period
):
    options = ModelOptions(boundary="periodic", cells_per_period=cells_per_period)
    state = relaxed(*pure(of, options), FINE)
    assert state.converged
    assert float(state.energy.total) == pytest.approx(0, abs=1e-12)
    axis = 0 if of.knit == "rib" else 1
    assert state.configuration.lengths[axis] == pytest.approx(of.period * of.contraction, rel=1e-6)


def test_hinges_of_other_knits_keep_their_stiffness():
    options = ModelOptions(boundary="periodic", cells_per_period=8, ridge_fraction=0.2)
    pattern = replace(patch_map(["RGP"], 1), cells_per_period=8)
    rib, garter = fold_stiffness_factors(pattern, options)
    assert (rib[:, [0, *range(8, 24)]] == 1).all()
    assert (garter[:, :8] == 1).all()
    assert (garter[:, 16:] == 1).all()
    assert (rib[:, 1:8] != 1).any()
    # The patch is as high as the fabric, so that its folds continue across the periodic boundary.
    assert (garter[:, 8:16] != 1).any()
