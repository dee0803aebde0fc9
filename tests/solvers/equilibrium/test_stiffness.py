from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.energy import (
    COMPLETE,
    HINGE_ENTRIES,
    SPRING_ENTRIES,
    Stage,
    element_vectors,
    energy,
    hinge_energy,
    spring_energy,
    spring_stiffness,
)
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.network import HINGE_VECTORS, Network
from knitlab.model.settings import ModelOptions
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.solvers.loads.loading import all_free, loading_of
from tests.fabrics import checkered, padded_hinge_stiffness, shaken, staged, whole_element_hessians


def whole_stiffness(
    free: FreeStiffness, net: Network, fabric: Fabric, stage: Stage, at: jax.Array
) -> np.ndarray:
    lower = free.lower(free.entries(whole_element_hessians(net, fabric, stage, at))).toarray()
    return lower + np.tril(lower, -1).T


@pytest.mark.slow
@pytest.mark.parametrize("angle", ["whole_normals", "across_edge"])
def test_element_hessians_are_those_of_automatic_differentiation(angle):
    net, fabric = checkered(4, 1, ModelOptions(boundary="periodic", hinges="all", fold_angle=angle))
    at = shaken(flat_sheet(net, fabric), 0.1)
    springs = element_vectors(net.springs, at)
    numbers = fabric.rest_length, fabric.stretch_stiffness
    exact = jax.vmap(jax.hessian(spring_energy), (-1, 0, 0))(springs, *numbers)[:, 0, :, 0]
    assert np.allclose(
        spring_stiffness(springs[0], *numbers), exact[:, *SPRING_ENTRIES].T, atol=1e-13
    )
    hinges = element_vectors(net.hinges, at)
    turned = fabric.rest_fold, fabric.fold_stiffness
    by_vectors = jax.vmap(jax.hessian(partial(hinge_energy, of=angle)), (-1, 0, 0))(hinges, *turned)
    by_nodes = np.einsum("vn,evrwc,wm->enrmc", HINGE_VECTORS, by_vectors, HINGE_VECTORS)
    exact = by_nodes.reshape(-1, 18, 18)[:, *HINGE_ENTRIES]
    laned = (
        np.asarray(padded_hinge_stiffness(hinges, *turned, angle))
        .transpose(0, 2, 1)
        .reshape(-1, 171)
    )
    assert np.allclose(laned[: len(exact)], exact, atol=1e-13)
    assert not laned[len(exact) :].any()


@pytest.mark.slow
@pytest.mark.parametrize("hinges", ["all", "fold_lines"])
@pytest.mark.parametrize("boundary", ["clamped", "periodic"])
def test_stiffness_is_the_slope_of_the_gradient(boundary, hinges):
    net, fabric = checkered(4, 1, ModelOptions(boundary=boundary, hinges=hinges))
    at = shaken(flat_sheet(net, fabric), 0.1).flattened()
    free = free_stiffness(net.shape, all_free(net.shape))
    part = Stage(fold=0.7, wall=0.3)
    matrix = whole_stiffness(free, net, fabric, part, at)
    acting = staged(fabric, part)
    gradient = jax.jit(
        jax.grad(lambda q: energy(net, acting, Configuration.of(q, net.shape)).total)
    )
    toward = np.random.default_rng(1).normal(size=at.shape)
    toward = jnp.zeros_like(at).at[free.dofs].set(toward[free.dofs])
    step = 1e-5
    slope = (gradient(at + step * toward) - gradient(at - step * toward)) / (2 * step)
    product = matrix @ np.asarray(toward)[free.dofs]
    assert np.allclose(product, np.asarray(slope)[free.dofs], rtol=1e-6, atol=1e-7)


@pytest.mark.slow
@pytest.mark.nightly
def test_walls_and_held_unknowns_enter_the_stiffness():
    net, fabric = checkered(4, 1, ModelOptions(boundary="clamped"))
    sheet = shaken(flat_sheet(net, fabric), 0.1)
    raised = Configuration(sheet.positions + np.array([0, 0, 6.0]), sheet.lengths)
    at, loading = raised.flattened(), loading_of(net.shape, raised)
    free = free_stiffness(net.shape, loading.free)
    matrix = whole_stiffness(free, net, fabric, COMPLETE, at)
    exact = np.asarray(
        jax.hessian(lambda q: energy(net, fabric, Configuration.of(q, net.shape)).total)(at)
    )
    assert np.allclose(matrix, exact[np.ix_(free.dofs, free.dofs)], atol=1e-12)
    beyond = np.asarray(raised.positions[..., 2]) > 6.0
    assert 0 < beyond.sum() < beyond.size
