"""The arc tangent of the dynamics, against NumPy's."""

import jax
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from knitlab.solvers.dynamics.vectors import arctan2

COMPILED = jax.jit(arctan2)
UNITS = 4
"""Units in the last place by which it may differ."""
NUMBERS = st.floats(1e-100, 1e100) | st.floats(-1e100, -1e-100) | st.just(0.0)


def assert_equals_numpy(y, x):
    found, expected = np.asarray(COMPILED(y, x)), np.arctan2(y, x)
    assert (np.abs(found - expected) <= UNITS * np.spacing(np.abs(expected))).all()


@given(y=NUMBERS, x=NUMBERS)
def test_it_equals_that_of_numpy(y, x):
    if y == x == 0:
        return
    assert_equals_numpy(np.float64(y), np.float64(x))


def test_it_does_so_in_all_quadrants_and_on_all_axes():
    # Both sides of where its formulas change, at multiples of π/8 and of π/4.
    angle = np.arange(-16, 17) * np.pi / 16
    angle = np.concatenate([angle, angle + 1e-9, angle - 1e-9, np.linspace(-np.pi, np.pi, 10001)])
    for size in (1e-30, 1.0, 1e30):
        assert_equals_numpy(size * np.sin(angle), size * np.cos(angle))
