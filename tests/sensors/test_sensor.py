"""Figures of merit of a sensor, on curves for which they are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.observables.capacitance.sensor import (
    hysteresis,
    mean_slope,
    sensing_range,
    sensor_values,
    strain_unfolded,
    widest_linear,
)

STRAIN = np.linspace(0.1, 0.6, 26)


@given(st.floats(-9, 9).filter(lambda slope: abs(slope) > 1e-3))
def test_a_straight_line_is_linear_all_along(slope):
    sensor = sensor_values(STRAIN, 20 + slope * STRAIN, 0.99)
    assert sensor["sensitivity"] == pytest.approx(abs(slope))
    assert sensor["gauge_factor"] == pytest.approx(slope / (20 + slope * 0.1))
    assert sensor["linearity"] == pytest.approx(1)
    assert sensor["working_range"] == pytest.approx(0.5)
    assert sensor["working_start"] == pytest.approx(0.1)
    assert sensor["working_slope"] == pytest.approx(slope)


@given(st.floats(0.1, 9), st.floats(0.0, 15.0))
def test_humidity_reads_like_the_strain_that_changes_the_fabrics_part_as_much(slope, leads):
    curve = 20 + slope * STRAIN
    sensor = sensor_values(STRAIN, curve, 0.99, leads)
    moister = leads + 1.05 * (curve[0] - leads)
    assert curve[0] + slope * sensor["humidity_strain"] == pytest.approx(moister)


def test_a_constant_capacitance_has_no_sensitivity():
    sensor = sensor_values(STRAIN, np.full(STRAIN.size, 3.0), 0.99)
    assert (sensor["sensitivity"], sensor["linearity"], sensor["working_range"]) == (0, 0, 0)


def test_two_points_are_too_few():
    assert sensor_values(STRAIN[:2], STRAIN[:2], 0.99) == {}


def test_the_mean_slope_is_that_of_the_central_fifth():
    # 0.30 to 0.40 is the central fifth of 0.10 to 0.60; the curve has a kink in its middle.
    curve = np.where(STRAIN < 0.35, 5.0, 5.0 - 8 * (STRAIN - 0.35))
    fine = np.linspace(0.1, 0.6, 501)
    assert mean_slope(fine, np.interp(fine, STRAIN, curve)) == pytest.approx(4, rel=0.03)
    zigzag = 5 + 0.02 * np.abs((STRAIN / 0.02 - 5) % 2 - 1)
    assert mean_slope(STRAIN, zigzag) == pytest.approx(1, rel=1e-6)


def test_the_working_range_is_where_the_curve_is_straight():
    strain = np.linspace(0, 1, 201)
    curve = np.where(strain < 0.7, 3 - 2 * strain, 1.6 + 20 * (strain - 0.7) ** 2)
    start, end, slope = widest_linear(strain, curve, 0.9999)
    assert start == 0
    assert end == pytest.approx(0.7, abs=0.04)
    assert slope == pytest.approx(-2, rel=0.02)


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 0.999))
def test_no_window_wider_than_the_working_range_is_as_straight(seed, least):
    random = np.random.default_rng(seed)
    strain = np.linspace(0, 1, 15)
    curve = np.cumsum(random.normal(size=strain.size))
    start, end, _ = widest_linear(strain, curve, least)

    def squared(first, last):
        return np.corrcoef(strain[first : last + 1], curve[first : last + 1])[0, 1] ** 2

    found = [
        strain[last] - strain[first]
        for first in range(strain.size)
        for last in range(first + 2, strain.size)
        if squared(first, last) >= least + 1e-9
    ]
    assert end - start == pytest.approx(max(found, default=0.0))


@given(st.floats(0.01, 100), st.floats(0.1, 10))
def test_figures_of_merit_scale_with_their_units(capacitance, strain):
    curve = 2 + np.tanh(8 * (STRAIN - 0.3))
    one = sensor_values(STRAIN, curve, 0.97)
    other = sensor_values(strain * STRAIN, capacitance * curve, 0.97)
    assert other["sensitivity"] == pytest.approx(one["sensitivity"] * capacitance / strain)
    assert other["gauge_factor"] == pytest.approx(one["gauge_factor"] / strain)
    assert other["linearity"] == pytest.approx(one["linearity"])
    assert other["working_range"] == pytest.approx(one["working_range"] * strain)


def test_hysteresis_is_the_widest_loop_over_the_range():
    loading = np.array([np.nan, 4.0, 3.0, 2.0])
    assert hysteresis(loading, np.array([9.0, 3.5, 3.0, 2.0])) == pytest.approx(0.25)
    assert hysteresis(loading, loading) == 0
    assert np.isnan(hysteresis(loading, np.full(4, np.nan)))


@pytest.mark.parametrize(
    ("fold", "part", "end"),
    [
        (2 * (1 - STRAIN / 0.7), 0.5, 0.4),  # a part of the fold is left
        (1 + (STRAIN - 0.4) ** 2, 0.1, 0.4),  # it begins to close again
        (2 - STRAIN, 0.1, np.nan),
        (2 + STRAIN, 0.1, np.nan),
    ],
)
def test_unfolding_ends_where_little_is_left_or_folds_close_again(fold, part, end):
    assert strain_unfolded(STRAIN, fold, part) == pytest.approx(end, nan_ok=True)


def test_the_sensing_range_is_the_longest_without_a_gap():
    able = np.array([True, False, True, True, True, False, True, True])
    for usable, longest in ((able, [2, 3, 4]), (able & False, []), (able | True, [*range(8)])):
        curve = np.where(usable, 1.0, np.nan)
        assert np.flatnonzero(sensing_range(np.arange(8.0), curve, 9.0)).tolist() == longest


def test_the_sensing_range_ends_at_unfolding_and_needs_a_capacitance():
    strain, missing = np.linspace(0, 0.6, 7), np.nan
    curve = np.array([missing, 5.0, 4.0, 3.0, 2.0, 1.0, 0.5])
    assert strain[sensing_range(strain, curve, 0.45)] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert sensing_range(strain, curve, missing).sum() == 6
