"""The position of a sample between walls before it is clamped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.network import MeshShape
from knitlab.solvers.equilibrium.alignment import between_walls, rigidly_aligned
from knitlab.solvers.loads.loading import loading_of
from tests.fabrics import CLAMPED, checkered, shaken

GAP = 0.5
"""Half the gap [mm]."""
SHAPE = MeshShape(12, 8, periodic=False)


def corrugated() -> np.ndarray:
    """Nodes of a sheet whose ridges just fit between the walls [mm]."""
    x, y = np.mgrid[:13, :9].reshape(2, -1).astype(float)
    return np.stack([x, y, GAP * np.cos(np.pi * x)], axis=1)


def configuration(nodes: np.ndarray) -> Configuration:
    return Configuration(nodes.reshape(13, 9, 3), np.array([13.0, 9.0]))


def test_a_sample_that_fits_stays_where_it_is():
    before = configuration(0.9 * corrugated())
    after = between_walls(SHAPE, before, GAP)
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-12)


@given(tilt=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)), lift=st.floats(-0.3, 0.3))
def test_a_tilted_sample_is_moved_rigidly_between_the_walls(tilt, lift):
    nodes = corrugated()
    askew = Rotation.from_rotvec([*tilt, 0]).apply(nodes) + np.array([0, 0, lift])
    laid = between_walls(SHAPE, configuration(askew), GAP)
    assert np.abs(laid.positions[..., 2]).max() <= GAP + 1e-6
    np.testing.assert_allclose(pdist(laid.positions.reshape(-1, 3)), pdist(nodes), rtol=1e-9)
    assert laid.lengths == pytest.approx([13.0, 9.0])


def test_a_sample_too_thick_is_pushed_equally_by_both_walls():
    askew = configuration(1.2 * corrugated() + np.array([0, 0, 0.1]))
    heights = between_walls(SHAPE, askew, GAP).positions[..., 2]
    upper, lower = np.maximum(heights - GAP, 0), np.maximum(-heights - GAP, 0)
    assert upper.sum() == pytest.approx(lower.sum(), rel=1e-6)
    assert upper.sum() > 0


def test_a_path_is_extrapolated_by_the_polynomial_through_its_states():
    """Three states give the polynomial of second order at any spacing, two the straight line."""
    shape = MeshShape(4, 4, periodic=True)
    relaxed = Configuration(np.random.default_rng(0).normal(size=(4, 4, 3)), np.array([4.0, 4.0]))
    loading = loading_of(shape, relaxed)
    coefficients = np.random.default_rng(1).normal(size=(3, shape.unknowns))

    def state(strain: float, order: int) -> np.ndarray:
        powers = strain ** np.arange(order + 1)
        return loading.holding(powers @ coefficients[: order + 1], strain)

    for strains in ([0.0, 0.01], [0.0, 0.01, 0.03], [0.3, 0.2, 0.19]):
        order = len(strains) - 1
        passed = [(strain, state(strain, order)) for strain in strains]
        np.testing.assert_allclose(loading.ahead(passed, 0.07), state(0.07, order), atol=1e-10)


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
