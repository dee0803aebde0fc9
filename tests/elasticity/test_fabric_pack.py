"""A pack gives every fabric the energy, forces and Hessians that it has by itself."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.elasticity.element_chunks import HEIGHTS, ChunkedFabric
from knitlab.elasticity.evaluation import COMPLETE, Stage
from knitlab.elasticity.fabric_pack import LARGEST_PACK, FabricPack, pack_size
from knitlab.model.fabric import flat_sheet
from knitlab.model.options import ModelOptions
from tests.fabrics import checkered, shaken

STAGES = [COMPLETE, Stage(fold=0.5, wall=0.01), Stage(fold=0.7, wall=1.0)]


@pytest.mark.parametrize(
    ("boundary", "periods", "members"),
    [
        ("periodic", 1, (0, 1, 2)),
        ("periodic", 1, (2,)),
        ("periodic", 3, (2, 0)),
        ("clamped", 1, (0, 1, 2)),
    ],
)
def test_fabrics_of_a_pack_are_evaluated_as_each_by_itself(boundary, periods, members):
    net, fabric = checkered(4, periods, ModelOptions(boundary=boundary))
    fabrics = [
        jax.tree.map(lambda number, factor=factor: number * factor, fabric)
        for factor in (1.0, 0.9, 1.2)
    ]
    pack = FabricPack(net.shape, fabrics)
    points = {}
    for member in members:
        at = np.array(shaken(flat_sheet(net, fabrics[member]), 0.1 + 0.02 * member).flattened())
        # Some nodes are beyond the walls.
        at[2:-2:6] += float(fabric.z_max)
        points[member] = STAGES[member], at
    for _ in range(2):
        evaluations, hessians = pack.evaluate(points), pack.element_hessians(points)
        for member, (stage, at) in points.items():
            alone = ChunkedFabric.of(net.shape, fabrics[member])
            pairs = (
                (evaluations[member], alone.evaluate(stage, at)),
                (hessians[member], alone.element_hessians(stage, at)),
            )
            for packed, by_itself in pairs:
                leaves = jax.tree.leaves(packed), jax.tree.leaves(by_itself)
                for one, other in zip(*leaves, strict=True):
                    assert np.shape(one) == np.shape(other)
                    np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11)
        # Another stage and another configuration of the same fabrics.
        points = {k: (Stage(fold=0.9, wall=0.1), at * 1.01) for k, (_, at) in points.items()}


@given(st.integers(1, 4096))
def test_no_pack_takes_more_chunks_than_its_fabrics_by_themselves(nodes):
    size = pack_size(nodes)
    assert 1 <= size <= LARGEST_PACK
    assert -(-size * nodes // HEIGHTS) <= size * -(-nodes // HEIGHTS)


@pytest.mark.parametrize(("periods", "size"), [(1, 8), (2, 1), (3, 1), (4, 1)])
def test_packs_of_periodic_fabrics(periods, size):
    assert pack_size(64 * periods**2) == size
