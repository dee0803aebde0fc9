import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

from knitlab.mechanics.evaluation import evaluate, part_folded
from knitlab.mechanics.factorisation import factorise
from knitlab.mechanics.loading import all_free, tensile
from knitlab.mechanics.stiffness import free_stiffness
from knitlab.model.energy import energy
from knitlab.model.fabric import flat_sheet
from knitlab.model.reading import Reading
from tests.fabrics import checkered, shaken


@pytest.mark.parametrize("hinges", ["all", "fold_lines"])
@pytest.mark.parametrize("boundary", ["clamped", "periodic"])
def test_stiffness_is_the_slope_of_the_gradient(boundary, hinges):
    net, fabric = checkered(4, 1, Reading(boundary=boundary, hinges=hinges))
    at = shaken(flat_sheet(net, fabric), 0.1)
    free = free_stiffness(net.shape, all_free(net.shape))
    matrix = free.matrix(jax.tree.map(np.asarray, evaluate(net, fabric, jnp.asarray(0.7), at)))
    gradient = jax.jit(jax.grad(lambda q: energy(net, part_folded(fabric, 0.7), q).total))
    toward = shaken(jnp.zeros_like(at), 1.0, seed=1)
    toward = jnp.zeros_like(at).at[free.unknowns].set(toward[free.unknowns])
    step = 1e-5
    slope = (gradient(at + step * toward) - gradient(at - step * toward)) / (2 * step)
    product = matrix @ np.asarray(toward)[free.unknowns]
    assert np.allclose(product, np.asarray(slope)[free.unknowns], rtol=1e-6, atol=1e-7)
    assert abs(matrix - matrix.T).max() < 1e-13


def test_walls_and_held_unknowns_enter_the_stiffness():
    net, fabric = checkered(4, 1, Reading(boundary="clamped"))
    at = shaken(flat_sheet(net, fabric), 0.1).at[2:-2:3].add(6.0)
    loading = tensile(net.shape, np.asarray(at))
    free = free_stiffness(net.shape, loading.unknowns)
    matrix = free.matrix(jax.tree.map(np.asarray, evaluate(net, fabric, jnp.asarray(1.0), at)))
    exact = np.asarray(jax.hessian(lambda q: energy(net, fabric, q).total)(at))
    assert np.allclose(matrix.toarray(), exact[np.ix_(free.unknowns, free.unknowns)], atol=1e-12)
    beyond = np.asarray(at[2:-2:3]) > 6.0
    assert 0 < beyond.sum() < len(beyond)


@pytest.mark.parametrize("eigenvalue", [1e-3, -1e-3])
def test_only_a_positive_definite_matrix_is_factorised(eigenvalue):
    rng = np.random.default_rng(0)
    directions, _ = np.linalg.qr(rng.normal(size=(30, 30)))
    values = np.linspace(1, 2, 30)
    values[7] = eigenvalue
    matrix = directions * values @ directions.T
    factors = factorise(sp.csc_array((matrix + matrix.T) / 2))
    assert (factors is not None) == (eigenvalue > 0)
    if factors is not None:
        assert np.allclose(matrix @ factors.solve(np.ones(30)), 1)
