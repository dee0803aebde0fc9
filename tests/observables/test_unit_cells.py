import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from knitlab.model.cell_grid import central
from knitlab.model.fabric import flat_sheet
from knitlab.observables.unit_cells import (
    central_mean,
    deformation_gradient,
    lattice_vectors,
    local_strain,
    poisson_ratio,
    unit_cell_corners,
)
from tests.fabrics import CLAMPED, PERIODIC, cell_of, checkered, even_cells

ENTRY = st.floats(-1, 1)
MATRIX = st.tuples(ENTRY, ENTRY, ENTRY, ENTRY).map(
    lambda e: np.eye(2) + 0.8 * np.reshape(e, (2, 2))
)


def skewed_corners(rows=3, columns=4, seed=0):
    y, x = np.mgrid[:rows, :columns].astype(float)
    grid = np.stack([10 * x + 2 * y, 12 * y - x], axis=-1)
    return grid + np.random.default_rng(seed).normal(size=grid.shape)


@given(MATRIX, st.tuples(ENTRY, ENTRY))
def test_the_gradient_of_an_affine_motion_is_exact(gradient, shift):
    assume(abs(np.linalg.det(gradient)) > 1e-2)
    reference = skewed_corners()
    current = reference @ gradient.T + shift
    found = deformation_gradient(lattice_vectors(reference), lattice_vectors(current))
    assert np.allclose(found, gradient, atol=1e-9)
    strain_xx, strain_yy = local_strain(reference, current)
    assert np.allclose(strain_xx, gradient[0, 0] - 1, atol=1e-9)
    assert np.allclose(strain_yy, gradient[1, 1] - 1, atol=1e-9)


@given(st.floats(-1.5, 1.5), MATRIX)
def test_a_rotation_multiplies_the_gradient(angle, gradient):
    assume(abs(np.linalg.det(gradient)) > 1e-2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    reference = skewed_corners()
    current = reference @ gradient.T @ turn.T
    found = deformation_gradient(lattice_vectors(reference), lattice_vectors(current))
    assert np.allclose(found, turn @ gradient, atol=1e-9)


def test_opposite_edges_are_averaged():
    corners = np.array([[[0.0, 0.0], [2.0, 0.0]], [[0.0, 3.0], [4.0, 5.0]]])
    vectors = np.asarray(lattice_vectors(corners))[0, 0]
    assert vectors[:, 0].tolist() == [3.0, 1.0]
    assert vectors[:, 1].tolist() == [1.0, 4.0]


@pytest.mark.parametrize(
    ("count", "kept"), [(1, 1), (2, 2), (3, 1), (4, 2), (5, 1), (6, 2), (11, 3), (22, 8)]
)
def test_the_central_cells_are_the_middle_third(count, kept):
    cells = range(count)[central(count)]
    assert len(cells) == kept
    assert cells[0] == count - 1 - cells[-1]


def test_means_ignore_the_cells_at_the_edges():
    strain = np.full((5, 3), 9.0)
    strain[2, 1] = 0.25
    assert float(central_mean(strain)) == 0.25


def test_poisson_ratio_is_undefined_without_axial_strain():
    ratio = np.asarray(poisson_ratio(np.array([0.1, 0.1]), np.array([0.2, 0.0])))
    assert ratio[0] == -0.5
    assert np.isnan(ratio[1])


@pytest.mark.slow
@pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])
def test_corners_of_the_flat_sheet_are_its_lattice(options):
    net, fabric = checkered(4, 1, options, unit_cells=(3, 2))
    corners = np.asarray(
        unit_cell_corners(net.shape, even_cells(net.shape, (3, 2)), flat_sheet(net, fabric))
    )
    y, x = np.mgrid[:4, :3]
    assert np.allclose(corners, np.stack([x, y], axis=-1) * 8 * cell_of(fabric))


@pytest.mark.slow
def test_strains_are_equal_in_numpy_and_in_jax():
    corners = np.random.default_rng(0).normal(size=(3, 4, 5, 2)) + np.mgrid[:4, :5].T.swapaxes(0, 1)
    for found, library in ((corners, np), (jnp.asarray(corners), jnp)):
        strains = local_strain(found[0], found)
        ratio = poisson_ratio(*(central_mean(strain) for strain in strains))
        assert isinstance(ratio, library.ndarray)
        assert np.asarray(ratio).dtype == np.float64
        if library is np:
            expected = ratio
    assert np.allclose(ratio, expected, rtol=1e-12, equal_nan=True)
