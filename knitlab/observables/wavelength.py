"""Wavelength and amplitude of a wavy line (paper, Sec. "Relaxation of a pattern", DFT analysis).

The line is a boundary between unit cells. The bending of the whole sample is removed with a
Savitzky–Golay filter, the rest is resampled evenly, and the peak of its discrete Fourier transform
gives λ = 1/ν̃_peak. Tapering and zero padding interpolate the spectrum; the top of the peak is that
of a parabola through three points of its logarithm.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from knitlab.model.cell_grid import CellGrid
from knitlab.model.network import MeshShape

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration

POINTS = 512  # number of points of a resampled line; more than any line of nodes or pixels resolves
PADDING = 16  # length of the padded line over its own
TREND_WINDOW = 1.7343
"""Window of the filter in wavelengths: the lowest at which a quadratic Savitzky–Golay filter
passes nothing of the wave, so that removing the trend does not change the wave."""
ROUNDS = 3  # number of iterations of window and wavelength
MIN_WAVES = 2  # waves along a line below which a trend cannot be distinguished from a wave
PERIODIC_CELLS = 8  # number of unit cells over which the boundary of periodic fabric is traced

Direction = Literal["x", "y"]


@dataclass(frozen=True)
class Wave:
    """The wave in a line [mm]; ``across`` is the line without its trend, at points ``along`` it."""

    wavelength: float
    amplitude: float
    along: Float[np.ndarray, " point"]
    across: Float[np.ndarray, " point"]


def boundary_line(
    shape: MeshShape, cells: CellGrid, configuration: "Configuration", direction: Direction
) -> Float[np.ndarray, "point 2"]:
    """The boundary between unit cells nearest the middle, seen from above (along, across) [mm].

    In periodic fabric it crosses :data:`PERIODIC_CELLS` cells.
    """
    nodes, sides = np.asarray(configuration.positions)[..., :2], configuration.lengths
    if direction == "x":
        line, length = nodes[cells.rows[cells.count[0] // 2]], sides[0]
    else:
        line, length = nodes[:, cells.columns[cells.count[1] // 2], ::-1], sides[1]
    if not shape.periodic:
        return line
    turns = np.stack([length * np.arange(PERIODIC_CELLS), np.zeros(PERIODIC_CELLS)], axis=-1)
    return (turns[:, None] + line).reshape(-1, 2)


def boundary_wave(
    shape: MeshShape, cells: CellGrid, configuration: "Configuration", direction: Direction
) -> Wave | None:
    """The wave of that boundary; ``None`` if it crosses too few unit cells."""
    waves = cells.count[1 if direction == "x" else 0] * (PERIODIC_CELLS if shape.periodic else 1)
    if waves < MIN_WAVES:
        return None
    return wave_of(boundary_line(shape, cells, configuration, direction), waves)


def wave_of(line: Float[np.ndarray, "point 2"], waves: float) -> Wave:
    """The strongest wave in a line of points (along, across) in any order [mm].

    Only waves within a factor of two of the stated number of waves are searched. Raises ValueError
    for fewer than two waves, too few points to resolve them, or a point that is not finite.
    """
    if waves < MIN_WAVES:
        raise ValueError(f"{waves:g} waves are too few for a wavelength; trace 2 at least")
    if not np.isfinite(line).all():
        raise ValueError("a point of the line is not finite; leave it out")
    points, group = np.unique(line[:, 0], return_inverse=True)
    if len(points) < 4 * waves:
        raise ValueError(f"{len(points)} points cannot resolve {waves:g} waves; give 4 for each")
    offsets = np.bincount(group.ravel(), line[:, 1]) / np.bincount(group.ravel())
    along = np.linspace(points[0], points[-1], POINTS)
    raw = np.interp(along, points, offsets)
    extent = float(along[-1] - along[0])
    wavelength = expected = extent / waves
    for _ in range(ROUNDS):
        across = raw - _trend(raw, wavelength / extent)
        wavenumber, amplitude = _peak(across, extent, (0.5 / expected, 2 / expected))
        wavelength = 1 / wavenumber
    return Wave(wavelength, amplitude, along - along[0], across)


def spectrum(
    across: Float[np.ndarray, " point"], extent: float
) -> tuple[Float[np.ndarray, " wavenumber"], Float[np.ndarray, " wavenumber"]]:
    """Wavenumbers ν̃ [1/mm], and the amplitude of a sinusoid at each, of an even line [mm]."""
    taper = np.hanning(len(across))
    transform = np.fft.rfft((across - across.mean()) * taper, PADDING * len(across))
    spacing = extent / (len(across) - 1)
    return np.fft.rfftfreq(PADDING * len(across), spacing), 2 * abs(transform) / taper.sum()


def _trend(raw: Float[np.ndarray, " point"], wavelength: float) -> Float[np.ndarray, " point"]:
    """Variation slower than the wave, whose length is relative to that of the line."""
    window = min(round(TREND_WINDOW * wavelength * len(raw)), len(raw))
    return quadratic_filter(raw, window - (window % 2 == 0))


def quadratic_filter(raw: Float[np.ndarray, " point"], window: int) -> Float[np.ndarray, " point"]:
    """What ``scipy.signal.savgol_filter(raw, window, 2)`` returns, whose import takes 0.4 s."""
    from scipy.linalg import lstsq
    from scipy.ndimage import convolve1d

    half = window // 2
    powers = np.arange(half, -half - 1.0, -1.0) ** np.arange(3.0)[:, None]
    smooth = convolve1d(raw, lstsq(powers, [1.0, 0.0, 0.0])[0], mode="constant")
    along = np.arange(window, dtype=float)
    smooth[:half] = np.polyval(np.polyfit(along, raw[:window], 2), along[:half])
    smooth[-half:] = np.polyval(np.polyfit(along, raw[-window:], 2), along[-half:])
    return smooth


def _peak(
    across: Float[np.ndarray, " point"], extent: float, within: tuple[float, float]
) -> tuple[float, float]:
    """Wavenumber and amplitude at the top of the highest peak between two wavenumbers."""
    wavenumbers, amplitudes = spectrum(across, extent)
    inside = np.flatnonzero((wavenumbers >= within[0]) & (wavenumbers <= within[1]))
    top = inside[np.argmax(amplitudes[inside])]
    before, middle, after = np.log(np.maximum(amplitudes[top - 1 : top + 2], np.finfo(float).tiny))
    curvature = before - 2 * middle + after
    shift = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    height = float(np.exp(middle - 0.25 * (before - after) * shift))
    return float(wavenumbers[top] + shift * wavenumbers[1]), height
