import numpy as np
import pytest

from knitlab.model.network import SMALL_KEPT, MeshShape, cached_by_shape, network


@pytest.mark.parametrize(("cells_y", "cells_x"), [(4, 4), (8, 12)])
def test_an_open_sheet_has_the_springs_and_hinges_of_a_grid(cells_y, cells_x):
    net = network(MeshShape(cells_y, cells_x, periodic=False))
    assert net.weft.sum() == (cells_y + 1) * cells_x
    assert net.warp.sum() == cells_y * (cells_x + 1)
    assert (~net.weft & ~net.warp).sum() == 2 * cells_y * cells_x
    assert net.wale.sum() == cells_y * (cells_x - 1)
    assert (~net.wale).sum() == (cells_y - 1) * cells_x
    assert not net.springs.images.any()
    assert not net.hinges.images.any()


def test_a_periodic_sheet_has_one_edge_of_each_kind_per_cell():
    net = network(MeshShape(8, 12, periodic=True))
    assert net.weft.sum() == net.warp.sum() == net.wale.sum() == (~net.wale).sum() == 96
    assert net.shape.nodes == 96


def test_only_elements_across_the_periodic_boundary_depend_on_the_lengths():
    net = network(MeshShape(8, 12, periodic=True))
    across = net.springs.periods.any(axis=(0, 1))
    assert across.sum() == 8 + 12 + 2 * (8 + 12 - 1)


@pytest.mark.parametrize("periodic", [False, True])
def test_the_nodes_of_a_hinge_are_distinct(periodic):
    net = network(MeshShape(4, 4, periodic))
    assert all(len(np.unique(nodes)) == 6 for nodes in net.hinges.nodes)


LARGE = MeshShape(100, 100, periodic=False)


def counted():
    """A cached function, and the shapes that it was computed for."""
    computed = []

    @cached_by_shape
    def nodes(shape, factor=1):
        computed.append((shape, factor))
        return factor * shape.nodes

    return nodes, computed


def test_many_small_shapes_do_not_evict_the_sample_that_they_are_parts_of():
    nodes, computed = counted()
    nodes(LARGE)
    for cells in range(2, SMALL_KEPT):
        nodes(MeshShape(cells, 3, periodic=False))
    before = len(computed)
    assert nodes(LARGE) == 101 * 101
    assert nodes(MeshShape(2, 3, periodic=False)) == 12
    assert len(computed) == before
