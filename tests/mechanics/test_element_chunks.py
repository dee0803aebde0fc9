"""Portions: put together they make up the fabric, whatever its mesh shape."""

import jax
import numpy as np
import pytest

from knitlab.linalg.threads import ALONE, Threads
from knitlab.mechanics import element_chunks
from knitlab.mechanics.element_chunks import HEIGHTS, ChunkedFabric, portions
from knitlab.mechanics.evaluation import Stage, element_hessians, evaluate
from knitlab.model.fabric import flat_sheet
from knitlab.model.options import ModelOptions
from tests.fabrics import checkered, shaken

PART = Stage(fold=0.7, wall=0.3)
SHEETS = [("clamped", 1), ("clamped", 4), ("periodic", 1), ("periodic", 4)]
"""Of less than one portion, and of some that are not all full."""


@pytest.fixture
def shared(monkeypatch):
    """Small samples are worth sharing."""
    monkeypatch.setattr(element_chunks, "WORTH_SHARING", 2)
    portions.cache_clear()
    yield
    portions.cache_clear()


@pytest.mark.parametrize(("boundary", "periods"), SHEETS)
@pytest.mark.parametrize(
    "angle", ["whole_normals", pytest.param("across_edge", marks=pytest.mark.slow)]
)
def test_energy_forces_and_hessians_are_those_of_the_whole(boundary, periods, angle):
    net, fabric = checkered(4, periods, ModelOptions(boundary=boundary, fold_angle=angle))
    full, spare = divmod(net.shape.nodes, HEIGHTS)
    assert (full > 0) == (periods > 1)
    assert spare or boundary == "periodic"
    at = np.array(shaken(flat_sheet(net, fabric), 0.1).flattened())
    at[2:-2:6] += float(fabric.z_max)
    portioned = ChunkedFabric.of(net.shape, fabric)
    pairs = [
        (portioned.evaluate(PART, at), evaluate(net, fabric, PART, at)),
        (portioned.element_hessians(PART, at), element_hessians(net, fabric, PART, at)),
    ]
    for found, whole in pairs:
        for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(whole), strict=True):
            assert np.shape(one) == np.shape(other)
            assert np.allclose(one, other, rtol=1e-12, atol=1e-12)
    parts = pairs[0][0].energy
    assert min(float(part) for part in (parts.stretch, parts.fold, parts.wall)) > 0


def test_the_incidence_of_any_motion_of_the_whole_is_none():
    """Vectors are differences: moved as a whole, a sheet has the same, but for its heights."""
    its = portions(checkered(4, 1, ModelOptions(boundary="clamped"))[0].shape)
    for axis in (0, 1):
        moved = np.zeros(its.shape.unknowns)
        moved[axis:-2:3] = 1.0
        assert not any(share.vectors(moved).any() for share in its.shares)
    moved = np.zeros(its.shape.unknowns)
    moved[2:-2:3] = 1.0
    assert sum(share.vectors(moved).sum() for share in its.shares) == its.shape.nodes


def test_shares_make_up_all_portions_and_threads_change_no_bit(shared):
    net, fabric = checkered(4, 4, ModelOptions(boundary="clamped", hinges="all"))
    its = portions(net.shape)
    assert [portion for share in its.shares for portion in share.portions] == [*range(its.count)]
    assert len(its.shares) == 2
    at = np.array(shaken(flat_sheet(net, fabric), 0.1).flattened())
    alone, threads = (
        ChunkedFabric.of(net.shape, fabric, threads) for threads in (ALONE, Threads(2))
    )
    for look in (ChunkedFabric.evaluate, ChunkedFabric.element_hessians):
        pairs = (jax.tree.leaves(look(of, PART, at)) for of in (alone, threads))
        for one, other in zip(*pairs, strict=True):
            assert np.array_equal(one, other)
    whole = jax.tree.leaves(evaluate(net, fabric, PART, at))
    for one, other in zip(jax.tree.leaves(alone.evaluate(PART, at)), whole, strict=True):
        assert np.allclose(one, other, rtol=1e-12, atol=1e-12)
