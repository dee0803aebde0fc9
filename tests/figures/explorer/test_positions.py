"""Positions: unpacked by other code they are the packed ones, as far as 12 bits can tell."""

import base64
import zlib

import numpy as np
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from knitlab.figures.explorer.shapes import LEVELS, pack_positions
from tests.figures.explorer.conftest import PREVIEW

NODES = array_shapes(min_dims=3, max_dims=3, max_side=5).map(lambda shape: (*shape, 3))
LENGTHS = st.floats(-500, 500, width=32)


def unpacked(packed, shape):
    """Positions, from the text: number by number, as the format says."""
    strains, rows, columns, _ = shape
    split = zlib.decompress(base64.b64decode(packed["positions"]))
    assert len(split) == 2 * np.prod(shape)
    half = len(split) // 2
    positions = np.empty((strains, 3, rows, columns))
    count = 3 * rows * columns
    for place in range(count):
        level = slope = 0
        component, row, column = np.unravel_index(place, (3, rows, columns))
        for strain in range(strains):
            number = split[strain * count + place] + 256 * split[half + strain * count + place]
            slope += -(number + 1) // 2 if number % 2 else number // 2
            level += slope
            assert 0 <= level <= LEVELS
            positions[strain, component, row, column] = (
                packed["origin"][component] + level * packed["step"][component]
            )
    return np.moveaxis(positions, 1, -1)


@given(arrays(float, NODES, elements=LENGTHS))
def test_positions_are_off_by_half_a_step_at_most(positions):
    packed = pack_positions(positions)
    error = np.abs(unpacked(packed, positions.shape) - positions).max(axis=(0, 1, 2))
    assert (error <= np.array(packed["error"]) * (1 + 1e-6) + 1e-12).all()


def test_a_simulated_test_is_packed_in_less_than_a_byte_a_number():
    for path in (PREVIEW / "cases").glob("*.nc"):
        with xr.open_dataset(path) as case:
            positions = case["position"].values
        assert len(pack_positions(positions)["positions"]) < positions.size
