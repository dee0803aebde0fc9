"""Windows of strain, against integration and regression by SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import linregress

from knitlab.cubes.strain_window import REDUCTIONS, StrainWindow, gradient, root_mean_square
from knitlab.io.errors import InputError

GRID = np.array([0.0, 0.03, 0.06, 0.1, 0.2, 0.45])
CURVES = np.array([np.sin(9 * GRID), GRID**2 - 0.3])

windows = st.tuples(st.floats(0, 0.44), st.floats(0.005, 0.45)).map(
    lambda pair: StrainWindow(pair[0], min(pair[0] + pair[1], 0.45))
)


@given(windows)
def test_reductions_are_those_of_the_piecewise_linear_curve(window):
    at, curves = window.read(GRID, CURVES)
    assert at[0] == window.start
    assert at[-1] == window.stop
    width = window.stop - window.start
    even = np.linspace(window.start, window.stop, 20_001)
    inside = GRID[(window.start < GRID) & (window.stop > GRID)]
    fine = np.union1d(even, inside)
    points = inside if len(inside) else None
    for k, curve in enumerate(CURVES):

        def line(strain, curve=curve):
            return np.interp(strain, GRID, curve)

        mean = quad(line, window.start, window.stop, points=points)[0] / width
        square = quad(
            lambda x: line(x) ** 2,
            window.start,
            window.stop,
            points=points,
        )[0]
        assert REDUCTIONS["mean"](at, curves)[k] == pytest.approx(mean, abs=1e-9)
        assert REDUCTIONS["min"](at, curves)[k] == pytest.approx(line(fine).min(), abs=1e-7)
        assert REDUCTIONS["max"](at, curves)[k] == pytest.approx(line(fine).max(), abs=1e-7)
        spread = np.ptp(line(fine))
        assert REDUCTIONS["spread"](at, curves)[k] == pytest.approx(spread, abs=1e-7)
        fitted = linregress(even, line(even))
        slope, linearity = fitted.slope, fitted.rvalue**2
        assert REDUCTIONS["slope"](at, curves)[k] == pytest.approx(slope, rel=2e-3, abs=2e-3)
        assert REDUCTIONS["linearity"](at, curves)[k] == pytest.approx(linearity, abs=5e-3)
        assert root_mean_square(at, curves)[k] == pytest.approx(np.sqrt(square / width), rel=1e-3)


@given(windows, st.sampled_from(sorted(REDUCTIONS)))
def test_gradients_of_reductions_are_their_differences(window, reduction):
    at, curves = window.read(GRID, CURVES)
    curve, step = curves[0], 1e-6
    exact = gradient(reduction, at, curve)
    for place in range(0, len(at), 7):
        moved = np.zeros(len(at))
        moved[place] = step
        ahead, behind = (REDUCTIONS[reduction](at, (curve + s * moved)[None])[0] for s in (1, -1))
        assert exact[place] == pytest.approx((ahead - behind) / (2 * step), abs=1e-4)


def test_values_outside_a_known_curve_are_missing():
    values = np.array([[np.nan, -0.4, -0.3, -0.2, np.nan, np.nan]])
    known = {
        (0.03, 0.1): True,
        (0.03, 0.03): True,
        (0.1, 0.1): True,
        (0.02, 0.05): False,  # nothing is known below the first strain with a value
        (0.0, 0.1): False,
        (0.01, 0.01): False,
        (0.1, 0.15): False,
        (0.3, 0.3): False,
        (0.5, 0.6): False,
    }
    for (start, stop), expected in known.items():
        mean = REDUCTIONS["mean"](*StrainWindow(start, stop).read(GRID, values))
        assert np.isfinite(mean).all() == expected, (start, stop)


def test_a_single_strain_is_read_between_those_that_were_simulated():
    at, curves = StrainWindow(0.15, 0.15).read(GRID, CURVES)
    assert at.tolist() == [0.15]
    np.testing.assert_allclose(curves[:, 0], CURVES[:, 3:5].mean(axis=1))


@pytest.mark.parametrize("text", ["", "a", "0.2:0.1", "-0.1:0.2", "0.1:0.2:0.3", "nan", "0:inf"])
def test_an_invalid_window_is_refused(text):
    with pytest.raises(InputError, match="window"):
        StrainWindow.of(text, "target")
