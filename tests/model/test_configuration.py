"""Configurations: the vector of unknowns and back, of one state and of several, and gradients."""

import numpy as np
import pytest

from knitlab.model.fabric import Configuration, flat_sheet
from tests.fabrics import CLAMPED, PERIODIC, cell_of, checkered


@pytest.mark.parametrize("options", [CLAMPED, PERIODIC], ids=["clamped", "periodic"])
@pytest.mark.parametrize("states", [(), (3,), (2, 3)], ids=["one", "three", "two by three"])
def test_flattening_and_back_is_the_identity(options, states):
    shape = checkered(4, 1, options)[0].shape
    unknowns = np.random.default_rng(0).normal(size=(*states, shape.unknowns))
    configuration = Configuration.of(unknowns, shape)
    assert configuration.positions.shape == (*states, shape.nodes_y, shape.nodes_x, 3)
    assert configuration.lengths.shape == (*states, 2)
    np.testing.assert_array_equal(configuration.flattened(), unknowns)


def test_the_flat_sheet_lies_on_its_grid():
    net, fabric = checkered(4, 1, PERIODIC)
    flat = flat_sheet(net, fabric)
    width, height = cell_of(fabric)
    np.testing.assert_allclose(flat.positions[2, 3], [3 * width, 2 * height, 0])
    np.testing.assert_allclose(
        flat.lengths, [net.shape.cells_x * width, net.shape.cells_y * height]
    )
