import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from knitlab.observables.wavelength import quadratic_filter, spectrum, wave_of

LAMBDA, AMPLITUDE = 12.3, 1.5


def wavy(waves, phase=0.0, noise=0.0, bend=0.0, seed=0, points_per_wave=40):
    """A sinusoid of known wavelength on unevenly traced points, on top of a bent sample."""
    random = np.random.default_rng(seed)
    extent = waves * LAMBDA
    inner = np.sort(random.uniform(0, extent, int(points_per_wave * waves)))
    along = np.concatenate([[0], inner, [extent]])
    across = AMPLITUDE * np.sin(2 * np.pi * along / LAMBDA + phase)
    across += bend * (4 * (along / extent - 0.5) ** 2 + 0.3 * along / extent)
    across += noise * AMPLITUDE * random.normal(size=len(along))
    return np.stack([along, across], axis=-1)


@pytest.mark.parametrize(
    ("waves", "most"), [(3, 0.035), (4, 0.015), (5, 0.01), (7, 0.005), (11, 0.003)]
)
@given(
    phase=st.floats(0, 2 * np.pi),
    part=st.floats(-0.04, 0.04),
    bend=st.floats(-8, 8),
    seed=st.integers(0, 10_000),
)
def test_wavelength_of_a_noisy_wave_on_a_bent_sample(waves, most, phase, part, bend, seed):
    line = wavy(waves + part, phase, noise=0.05, bend=bend, seed=seed)
    found = wave_of(line, waves)
    assert found.wavelength == pytest.approx(LAMBDA, rel=most)
    assert found.amplitude == pytest.approx(AMPLITUDE, rel=0.08)


def test_a_line_of_three_waves_is_resolved_between_the_points_of_its_transform():
    """Neighbouring points of the transform without padding differ by a third."""
    found = [wave_of(wavy(waves), 3).wavelength for waves in (2.9, 3.0, 3.1)]
    assert found == pytest.approx([LAMBDA] * 3, rel=0.02)
    assert np.ptp(1 / np.array(found)) < 0.1 * (1 / (3 * LAMBDA))


def test_strong_ripples_of_the_folds_are_not_mistaken_for_the_wave():
    line = wavy(6)
    line[:, 1] += 2 * AMPLITUDE * np.sin(2 * np.pi * 4 * line[:, 0] / LAMBDA)
    assert wave_of(line, 6).wavelength == pytest.approx(LAMBDA, rel=0.01)


@given(shift=st.floats(-50, 50), scale=st.floats(0.1, 20), seed=st.integers(0, 1000))
def test_wavelength_moves_and_grows_with_the_fabric(shift, scale, seed):
    line = wavy(5, noise=0.05, seed=seed)
    one, other = wave_of(line, 5), wave_of(scale * line + shift, 5)
    assert other.wavelength == pytest.approx(scale * one.wavelength, rel=1e-6)
    assert other.amplitude == pytest.approx(scale * one.amplitude, rel=1e-6)


def test_the_order_of_the_points_does_not_matter():
    line = wavy(5, noise=0.05)
    mixed = np.random.default_rng(1).permutation(line)
    assert wave_of(mixed, 5).wavelength == wave_of(line, 5).wavelength


def test_the_trend_is_removed_and_the_wave_remains():
    found = wave_of(wavy(9, bend=8.0, points_per_wave=200), 9)
    exact = AMPLITUDE * np.sin(2 * np.pi * found.along / LAMBDA)
    inner = (found.along > LAMBDA) & (found.along < found.along[-1] - LAMBDA)
    assert np.abs(found.across - exact)[inner].max() < 0.1 * AMPLITUDE


def test_spectrum_of_a_sinusoid_is_as_high_as_the_sinusoid():
    along = np.linspace(0, 8 * LAMBDA, 512)
    wavenumbers, amplitudes = spectrum(AMPLITUDE * np.cos(2 * np.pi * along / LAMBDA), 8 * LAMBDA)
    assert amplitudes.max() == pytest.approx(AMPLITUDE, rel=1e-3)
    assert wavenumbers[amplitudes.argmax()] == pytest.approx(1 / LAMBDA, rel=5e-3)


@pytest.mark.parametrize(
    ("line", "waves", "words"),
    [
        (wavy(1), 1, "too few for a wavelength"),
        (wavy(5, points_per_wave=1), 5, "cannot resolve"),
        (wavy(5) * [1, np.nan], 5, "not finite"),
    ],
)
def test_a_line_that_shows_no_wave_is_refused(line, waves, words):
    with pytest.raises(ValueError, match=words):
        wave_of(line, waves)


@pytest.mark.parametrize("window", [3, 51, 301])
def test_the_filter_is_that_of_scipy(window):
    raw = np.cumsum(np.random.default_rng(window).normal(size=512))
    wanted = savgol_filter(raw, window, polyorder=2)
    np.testing.assert_allclose(quadratic_filter(raw, window), wanted, rtol=0, atol=1e-12)
