"""Chunks of elements give the results of the whole fabric, for any mesh shape."""

import jax
import numpy as np
import pytest

from knitlab.model.energy import Stage
from knitlab.model.fabric import flat_sheet
from knitlab.model.settings import ModelOptions
from knitlab.model.threads import ALONE, Threads
from knitlab.solvers import element_chunks
from knitlab.solvers.element_chunks import HEIGHTS, ChunkedFabric, thread_chunks
from tests.fabrics import checkered, evaluate_whole, shaken, whole_element_hessians

PART = Stage(fold=0.7, wall=0.3)
SHEETS = [("clamped", 1), ("clamped", 4), ("periodic", 1), ("periodic", 4)]
"""Mesh shapes of less than one chunk, and of several chunks that are not all full."""


@pytest.fixture
def shared(monkeypatch):
    """Makes small samples use several threads."""
    monkeypatch.setattr(element_chunks, "WORTH_SHARING", 2)
    monkeypatch.setattr(element_chunks, "thread_chunks", thread_chunks.__wrapped__)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("boundary", "periods", "angle"),
    [
        ("clamped", 4, "across_edge"),
        *((*sheet, "whole_normals") for sheet in SHEETS[:3]),
        (*SHEETS[3], "whole_normals"),
    ],
)
def test_energy_forces_and_hessians_equal_those_without_chunks(boundary, periods, angle):
    net, fabric = checkered(4, periods, ModelOptions(boundary=boundary, fold_angle=angle))
    full, spare = divmod(net.shape.nodes, HEIGHTS)
    assert (full > 0) == (periods > 1)
    assert spare or boundary == "periodic"
    at = np.array(shaken(flat_sheet(net, fabric), 0.1).flattened())
    at[2:-2:6] += float(fabric.z_max)
    chunked = ChunkedFabric(net.shape, fabric)
    pairs = [
        (chunked.evaluate(PART, at), evaluate_whole(net, fabric, PART, at)),
        (chunked.element_hessians(PART, at), whole_element_hessians(net, fabric, PART, at)),
    ]
    for found, whole in pairs:
        for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(whole), strict=True):
            assert np.shape(one) == np.shape(other)
            assert np.allclose(one, other, rtol=1e-12, atol=1e-12)
    parts = pairs[0][0].energy
    assert min(float(part) for part in (parts.stretch, parts.fold, parts.wall)) > 0


@pytest.mark.slow
def test_threads_share_all_chunks_and_give_identical_results(shared):
    net, fabric = checkered(4, 4, ModelOptions(boundary="clamped", hinges="all"))
    alone, threads = (ChunkedFabric(net.shape, fabric, threads) for threads in (ALONE, Threads(2)))
    chunks = [chunk for each in threads._by_thread for chunk in each.chunks]
    assert chunks == [*range(-(-net.shape.nodes // HEIGHTS))]
    assert len(threads._by_thread) == 2
    at = np.array(shaken(flat_sheet(net, fabric), 0.1).flattened())
    for method in (ChunkedFabric.evaluate, ChunkedFabric.element_hessians):
        pairs = (jax.tree.leaves(method(of, PART, at)) for of in (alone, threads))
        for one, other in zip(*pairs, strict=True):
            assert np.array_equal(one, other)
    whole = jax.tree.leaves(evaluate_whole(net, fabric, PART, at))
    for one, other in zip(jax.tree.leaves(alone.evaluate(PART, at)), whole, strict=True):
        assert np.allclose(one, other, rtol=1e-12, atol=1e-12)
