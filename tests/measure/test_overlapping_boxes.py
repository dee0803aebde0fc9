"""Broad phase: against every box compared with every image of every other."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from knitlab.fabric.network import mesh_shape
from knitlab.measure.overlapping_boxes import overlapping_boxes
from tests.fabrics import patch_map

Pair = tuple[int, int, int, int]


def one_of_two_sides(one: int, other: int, turns_y: int, turns_x: int) -> Pair:
    """Pairs in both orders."""
    return max((one, other, turns_y, turns_x), (other, one, -turns_y, -turns_x))


def overlapping(
    low: np.ndarray, high: np.ndarray, periods: np.ndarray, reach: int, first: int
) -> set[Pair]:
    turns = np.arange(-reach, reach + 1)
    moved = [turns * periods[1], turns * periods[0], np.zeros(1)]
    meets = [
        (low[axis][:, None, None] < high[axis][:, None] + by)
        & (high[axis][:, None, None] > low[axis][:, None] + by)
        for axis, by in enumerate(moved)
    ]
    every = np.argwhere(meets[1][..., :, None] & meets[0][..., None, :] & meets[2][..., None])
    return {
        one_of_two_sides(first + one, first + other, turns[y], turns[x])
        for one, other, y, x in every
        if (one, turns[y], turns[x]) != (other, 0, 0)
    }


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["clamped", "periodic"]),
    st.floats(0.5, 8.0),
    st.floats(0.05, 2.0),
)
def test_boxes_that_overlap_are_found_once(seed, boundary, period, extent):
    rng = np.random.default_rng(seed)
    shape = mesh_shape(patch_map(["R"], 1), boundary)
    cells = shape.cells_y * shape.cells_x
    low = rng.uniform(-2, 2, size=(3, 2, cells))
    high = low + rng.uniform(0.01, extent, size=low.shape)
    periods = period * np.array([[1.0, 1.2], [0.9, 1.5]])
    pairs = overlapping_boxes(shape, low, high, periods)
    found = [
        one_of_two_sides(*each) for each in zip(pairs.one, pairs.other, *pairs.turns, strict=True)
    ]
    reach = int((4 + extent) / periods.min()) + 1 if shape.periodic else 0
    expected = set()
    for state in range(2):
        of_state = low[:, state], high[:, state], periods[:, state], reach, state * cells
        expected |= overlapping(*of_state)
    assert len(found) == len(set(found))
    assert set(found) == expected
