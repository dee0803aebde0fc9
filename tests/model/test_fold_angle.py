from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from knitlab.model.energy import element_vectors
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.fold_angle import fold_from_rest
from tests.fabrics import CLAMPED, cell_of, checkered, shaken


def creased(net, fabric, axis=0, half=0.3):
    """A sheet folded along its middle to a mountain of twice an angle; its cells are planes."""
    flat = flat_sheet(net, fabric).positions
    ridge = 4.0 * cell_of(fabric)[axis]
    folded = np.array(flat)
    folded[..., axis] = ridge + (flat[..., axis] - ridge) * np.cos(half)
    folded[..., 2] = -np.abs(flat[..., axis] - ridge) * np.sin(half)
    return Configuration(folded, np.zeros(2))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("half", [0.3, 1.2])
def test_a_mountain_has_a_positive_angle_about_either_edge(axis, half):
    net, fabric = checkered(4, 1, CLAMPED)
    vectors = element_vectors(net.hinges, creased(net, fabric, axis, half))
    angles = fold_from_rest(vectors, jnp.zeros(vectors.shape[-1]), fabric.fold_angle)
    assert float(angles.max()) == pytest.approx(2 * half)
    assert float(angles.min()) == pytest.approx(0, abs=1e-12)


def test_an_angle_is_taken_on_the_branch_nearest_its_rest():
    net, fabric = checkered(4, 1, CLAMPED)
    vectors = element_vectors(net.hinges, shaken(flat_sheet(net, fabric), 0.3))
    rest = jnp.linspace(-np.pi, np.pi, vectors.shape[-1])
    angles = fold_from_rest(vectors, jnp.zeros(vectors.shape[-1]), fabric.fold_angle)
    difference = np.asarray(angles - rest)
    nearest = np.arctan2(np.sin(difference), np.cos(difference))
    assert np.allclose(fold_from_rest(vectors, rest, fabric.fold_angle), nearest, atol=1e-12)


_turns = st.floats(-3, 3)


@given(seed=st.integers(0, 2**32 - 1), twist=st.floats(-20, 20), turn=_turns, rest=_turns)
def test_across_the_edge_a_cell_that_turns_turns_the_angle_however_twisted_it_is(
    seed, twist, turn, rest
):
    edge, *diagonals = np.random.default_rng(seed).normal(size=(5, 3))
    # Diagonals shifted along the edge in opposite directions twist a cell: its normal then has a
    # component along the edge.
    sideways = np.cross(edge, diagonals[2])
    diagonals[2], diagonals[3] = diagonals[2] - twist * sideways, diagonals[3] + twist * sideways
    along = edge / np.linalg.norm(edge)
    normals = np.cross(diagonals[::2], diagonals[1::2])
    assume((np.linalg.norm(np.cross(along, normals), axis=1) > 1e-3).all())
    about = Rotation.from_rotvec(turn * along)
    hinges = np.array(
        [[edge, *diagonals], [edge, *diagonals[:2], *about.apply(diagonals[2:])]]
    ).transpose(1, 2, 0)
    before, after = np.asarray(
        fold_from_rest(jnp.asarray(hinges), jnp.full(2, rest), "across_edge")
    )
    difference = after - before - turn
    assert np.arctan2(np.sin(difference), np.cos(difference)) == pytest.approx(0, abs=1e-9)


def test_of_planar_cells_both_fold_angles_are_the_same():
    angles = []
    for choice in ("whole_normals", "across_edge"):
        net, fabric = checkered(4, 1, replace(CLAMPED, fold_angle=choice))
        vectors = element_vectors(net.hinges, creased(net, fabric))
        angles.append(fold_from_rest(vectors, fabric.rest_fold, fabric.fold_angle))
        twisted = element_vectors(net.hinges, shaken(flat_sheet(net, fabric), 0.1))
        angles.append(fold_from_rest(twisted, fabric.rest_fold, fabric.fold_angle))
    assert np.allclose(angles[0], angles[2], atol=1e-12)
    assert float(abs(angles[1] - angles[3]).max()) > 1e-3
