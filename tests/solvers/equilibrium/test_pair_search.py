"""Pairs that are kept while a fabric moves: the same forces and free steps as searched again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.solvers.equilibrium.contact_barrier import remaining_distance
from tests.solvers.equilibrium.test_contact_barrier import CELL, barrier_on

SEEDS = st.integers(0, 2**32 - 1)
CELLS = 12


def corrugated(numbers, periodic):
    """A fabric folded at random angles, some so sharp that plies touch, and rough."""
    shape = MeshShape(8, CELLS, periodic)
    angle = numbers.uniform(0.15, 1.2)
    row, column = np.mgrid[: shape.nodes_y, : shape.nodes_x]
    height = abs((np.arange(shape.nodes_x) + 1) % 4 - 2) * CELL * np.cos(angle / 2)
    nodes = np.stack([column * CELL * np.sin(angle / 2), row * CELL, 0.0 * row], axis=-1)
    nodes[..., 2] = height
    nodes += numbers.normal(size=nodes.shape, scale=1e-3)
    lengths = np.array([CELLS * CELL * np.sin(angle / 2), 8 * CELL]) * periodic
    return shape, Configuration(nodes, lengths)


def moved(numbers, shape, configuration):
    """The fabric stretched and roughened, by little or by much."""
    size = 10 ** numbers.uniform(-4, -1.2)
    stretch = 1 + numbers.normal(size=2, scale=0.3 * size)
    nodes = configuration.positions * np.append(stretch, 1.0)
    nodes = nodes + numbers.normal(size=nodes.shape, scale=0.1 * size)
    return Configuration(nodes, configuration.lengths * stretch)


@pytest.mark.slow
@pytest.mark.parametrize("periodic", [False, True])
@settings(max_examples=30)
@given(seed=SEEDS)
def test_kept_pairs_give_the_forces_and_free_steps_of_pairs_searched_anew(periodic, seed):
    numbers = np.random.default_rng(seed)
    shape, configuration = corrugated(numbers, periodic)
    kept = barrier_on(shape)
    for _ in range(6):
        unknowns = np.asarray(configuration.flattened())
        fresh = barrier_on(shape)
        if not fresh.holds(unknowns):
            break
        energies, gradients = zip(*(each.evaluate(unknowns) for each in (kept, fresh)), strict=True)
        assert energies[0] == pytest.approx(energies[1], rel=1e-9)
        np.testing.assert_allclose(*gradients, atol=1e-9 * max(1.0, abs(gradients[1]).max()))
        configuration = moved(numbers, shape, configuration)
        step = np.asarray(configuration.flattened()) - unknowns
        parts = [each.free_fraction(unknowns, step) for each in (kept, fresh)]
        assert parts[0] == pytest.approx(parts[1], rel=1e-6)


@given(SEEDS)
def test_no_distance_gets_shorter_than_it_may(seed):
    numbers = np.random.default_rng(seed)
    before = numbers.normal(size=(12, 3))
    shift, stretch = numbers.normal(size=3), 1 + numbers.normal(size=2, scale=0.1)
    after = before * np.append(stretch, 1.0) + shift + numbers.normal(size=(12, 3), scale=0.02)
    one, other = np.triu_indices(12, 1)
    distances = np.linalg.norm(before[one] - before[other], axis=1)
    left = np.linalg.norm(after[one] - after[other], axis=1)
    for distance, actual in zip(distances, left, strict=True):
        assert remaining_distance(distance, before, after) <= actual + 1e-12
