import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.lab.records import cycles, resampled

RESTS = np.array([[1, 1, 5], [5, 1, 1], [1, 1, 1]])
"""Time at rest at a reversal, which with noise may be detected anywhere within it."""
AT = np.linspace(0, 0.4, 11)


def test_parabolas_are_reproduced_exactly():
    strain = np.sort(np.random.default_rng(0).uniform(0, 0.4, 400))
    strain[[0, -1]] = 0, 0.4
    found, error, _ = resampled(AT, strain, np.stack([2 + 3 * strain**2, -strain], axis=1))
    np.testing.assert_allclose(found, np.stack([2 + 3 * AT**2, -AT], axis=1), atol=1e-12)
    np.testing.assert_allclose(error, 0, atol=1e-12)


def test_errors_are_those_that_noise_makes():
    strain = np.linspace(0, 0.4, 401)
    noise = np.random.default_rng(1).normal(0, 0.05, (401, 3000))
    found, error, sigma = resampled(AT, strain, (1 + strain)[:, None] + noise)
    astray = (found - (1 + AT)[:, None]) / error
    freedom = np.array([18, *[38] * 9, 18])
    np.testing.assert_allclose(astray.std(axis=1), np.sqrt(freedom / (freedom - 2)), atol=0.05)
    np.testing.assert_allclose(astray.mean(axis=1), 0, atol=0.1)
    np.testing.assert_allclose((sigma**2).mean(axis=1), 0.05**2, rtol=0.05)


def test_what_is_missing_is_missing_by_itself():
    strain = np.linspace(0, 0.4, 201)
    values = np.stack([strain, strain], axis=1)
    values[60:120, 1] = np.nan
    found = resampled(AT, strain, values).values
    np.testing.assert_allclose(found[:, 0], AT, atol=1e-12)
    lost = np.isnan(found[:, 1])
    assert lost.any()
    np.testing.assert_array_equal(lost & ~((strain[60] <= AT) & (strain[119] >= AT)), False)
    np.testing.assert_allclose(found[~lost, 1], AT[~lost], atol=1e-12)


def test_a_few_frames_are_joined_by_straight_lines_without_an_error():
    strain = np.linspace(0, 0.4, 11) + 0.01
    found, error, _ = resampled(AT[1:-1], strain, strain**2)
    np.testing.assert_allclose(found, np.interp(AT[1:-1], strain, strain**2))
    assert np.isnan(error).all()


def test_nothing_is_extrapolated_beyond_the_records():
    strain = np.linspace(0.1, 0.3, 101)
    found = resampled(AT, strain, strain).values
    np.testing.assert_array_equal(np.isfinite(found), (AT >= 0.1 - 1e-9) & (AT <= 0.3 + 1e-9))


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_cycles_of_any_shape_are_separated(noise):
    time = np.arange(0, 60, 0.1)
    peaks = np.interp(time, [0, 5, 15, 25, 30, 40, 50, 60], [0, 0, 2, 0.3, 0.3, 2.5, 0, 1])
    extension = peaks + np.random.default_rng(2).uniform(-noise, noise, len(time))
    found = cycles(time, extension, least_turn=0.1)
    turns = [(of.start, of.turn, of.end) for of in found]
    expected = [(5, 15, 30), (30, 40, 50), (50, 60, 60)]
    assert (np.abs(np.subtract(turns, expected)) <= (RESTS if noise else 0.2)).all()
    assert found[0].loaded(np.array([10.0])).all()
    assert found[0].unloaded(np.array([20.0])).all()


def test_a_test_without_strain_has_no_cycles():
    time = np.linspace(0, 1, 50)
    assert cycles(time, np.zeros(50), 0.1) == []
    assert cycles(time, -time, 0.1) == []


def test_a_single_loading_is_a_cycle_without_unloading():
    time = np.linspace(0, 1, 50)
    (only,) = cycles(time, time, 0.1)
    assert (only.start, only.turn, only.end) == (0, 1, 1)


@given(
    noise=st.sampled_from([0.0, 1e-4, 1e-3]),
    hold=st.floats(5.0, 300.0),
    stops=st.integers(0, 3),
    repeats=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_hold_is_neither_loading_nor_unloading(noise, hold, stops, repeats, seed):
    """Ramps of 0.2 mm/s to 7.5 mm, with stops in which the force relaxes by 30 %."""
    random, speed, peak, rate = np.random.default_rng(seed), 0.2, 7.5, 4.0
    levels = np.linspace(0, peak, stops + 2)[1:]
    extension, force = [np.zeros(1)], [np.zeros(1)]
    for _ in range(repeats):
        for low, high in zip([0.0, *levels[:-1]], levels, strict=True):
            ramp = np.linspace(low, high, round((high - low) / speed * rate) + 1)[1:]
            still = np.arange(1, round(hold * rate) + 1) / rate
            extension += [ramp, np.full(len(still), high)]
            force += [ramp**2, high**2 * (0.7 + 0.3 * np.exp(-still / 20))]
        back = np.linspace(peak, 0, round(peak / speed * rate) + 1)[1:]
        extension += [back, np.zeros(8)]
        relaxed = 0.7 + 0.3 * np.exp(-still[-1] / 20)
        force += [relaxed * back**2, np.zeros(8)]
    shown = np.concatenate(extension)
    shown = shown + random.normal(0, noise, len(shown)) if noise else shown
    measured, time = np.concatenate(force), np.arange(len(shown)) / rate
    found = cycles(time, shown, 0.1)
    assert len(found) == repeats
    at = np.linspace(0, peak, 16)
    for cycle in found:
        for phase, part in ((cycle.loaded, 1.0), (cycle.unloaded, relaxed)):
            during = phase(time)
            values = resampled(at, shown[during], measured[during]).values
            np.testing.assert_allclose(values, part * at**2, atol=0.01 * peak**2)


def test_a_slow_ramp_is_not_a_hold():
    """A preload at a tenth of the speed, and an extension in steps of the resolution."""
    slow = np.linspace(0, 0.5, 101)
    fast = np.linspace(0.5, 6, 111)[1:]
    for extension in (np.concatenate([slow, fast]), np.round(np.concatenate([slow, fast]), 2)):
        (cycle,) = cycles(np.arange(len(extension), dtype=float), extension, 0.1)
        assert cycle.loaded(np.arange(len(extension), dtype=float)).sum() > 0.9 * len(extension)
