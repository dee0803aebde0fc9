"""Boundaries, their spectra, and the wavelength against n_subunit (paper, Fig. "wavelength")."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cubes.derived import RELIABLE_WAVES
from knitlab.figures.cells import design_name
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, TWO_COLUMNS, Look
from knitlab.io.errors import invalid
from knitlab.lab.fit_statistics import linear_fit
from knitlab.observables.schema import DESIGN_DIMS
from knitlab.observables.status import Status

DIRECTIONS = {"x": "weft x", "y": "warp y"}
OTHER = {"x": "y", "y": "x"}
PEAK = CATEGORY_COLOURS[1]


@figure()
def wavelength(cube: xr.Dataset) -> Figure:
    """Boundaries, their spectra, and wavelengths against n_subunit (paper, Fig. "wavelength").

    Lengths are in cloth, by the gauge, as in the paper. Boundary and spectrum are of the smallest
    unit cell of n_stripe 4, or of the first n_stripe if there is no 4. Wavelengths from fewer than
    3 waves, which can be wrong by more than 5 %, are hollow; the slopes include them.
    """
    if "wavelength_x" not in cube or not cube["wavelength_y"].notnull().any():
        message = "no design of this selection has a wavelength; run samples of 2 unit cells or"
        raise invalid("wavelength", f"{message} more, or periodic fabric, with this version")
    figure = Figure(figsize=(TWO_COLUMNS, 4.2), layout="constrained")
    for row, direction in zip(figure.subplots(2, 3), DIRECTIONS, strict=True):
        wavelengths = cube[f"wavelength_{direction}"].transpose(*DESIGN_DIMS)
        designs = np.argwhere(np.isfinite(wavelengths.values)).tolist()
        if not designs:
            for axes in row:
                axes.set_axis_off()
            row[1].text(0.5, 0.5, "a single unit cell across", ha="center", va="center")
            continue
        n_stripe, n_subunit = min(designs, key=lambda each: cube["n_stripe"].values[each[0]] != 4)
        _draw_wave(row[0], row[1], cube.isel(n_stripe=n_stripe, n_subunit=n_subunit), direction)
        _draw_lines(row[2], cube, direction)
    return figure


def _to_cloth(design: xr.Dataset, direction: str) -> float:
    """Factor from a relaxed length of the network to that of the cloth, by the gauge."""
    relaxed = design[f"relaxed_cell_{direction}"]
    # A cube without sizes in cloth shows those of its network.
    return float(design.get(f"knit_cell_{direction}", relaxed) / relaxed)


def _draw_wave(line: Axes, axes: Axes, shown: xr.Dataset, direction: str) -> None:
    """Draw three wavelengths of a boundary, and its spectrum."""
    from knitlab.observables.wavelength import spectrum

    scale, other = _to_cloth(shown, direction), _to_cloth(shown, OTHER[direction])
    length = scale * float(shown[f"boundary_length_{direction}"])
    wavelength = scale * float(shown[f"wavelength_{direction}"])
    along = shown["boundary_point"].values * length
    across = other * shown[f"boundary_{direction}"].values
    within = abs(along - along[-1] / 2) <= 1.5 * wavelength
    line.plot(along[within], across[within], color="black", lw=0.9)
    line.set(xlabel=f"along the {DIRECTIONS[direction]} [mm]", ylabel="boundary's offset [mm]")
    line.set_title(f"boundary of {design_name(shown)}")
    wavenumbers, amplitudes = spectrum(across, length)
    within = wavenumbers <= 4 / wavelength
    axes.plot(wavenumbers[within], amplitudes[within], color="black", lw=0.9)
    peak = 1 / wavelength, other * float(shown[f"wave_amplitude_{direction}"])
    axes.plot(*peak, "o", ms=4, mfc="none", color=PEAK)
    beside: Look = {"xytext": (6, -2), "textcoords": "offset points"}
    axes.annotate(f"λ = {wavelength:.1f} mm", peak, color=PEAK, **beside)
    axes.set(xlabel="wavenumber [1/mm]", ylabel="amplitude [mm]", ylim=(0, 1.15 * peak[1]))
    axes.set_title(f"its spectrum, along {direction}")


def _draw_lines(axes: Axes, cube: xr.Dataset, direction: str) -> None:
    lengths = cube.get(f"knit_wavelength_{direction}", cube[f"wavelength_{direction}"])
    wavelengths = lengths.where(cube["status"] == Status.ok)
    few = cube.get(f"waves_{direction}", xr.full_like(lengths, RELIABLE_WAVES)) < RELIABLE_WAVES
    hollow = bool((few & wavelengths.notnull()).any())
    for n_stripe, colour, marker in zip(
        cube["n_stripe"].values, CATEGORY_COLOURS, MARKERS, strict=False
    ):
        line = wavelengths.sel(n_stripe=n_stripe).dropna("n_subunit")
        if not line.size:
            continue
        x, y = line["n_subunit"].values.astype(float), line.values
        uncertain = few.sel(n_stripe=n_stripe, n_subunit=line["n_subunit"]).values
        label = f"n_stripe = {n_stripe}"
        if line.size >= 3:
            fit = linear_fit(x, y)
            ends = np.array([x.min(), x.max()])
            axes.plot(ends, fit.intercept + fit.slope * ends, color=colour, lw=0.9)
            label += f": {fit.slope:.2f} ± {fit.slope_halfwidth:.2f}"
        axes.plot(x, y, marker, color=colour, ms=3.5, label=label)
        axes.plot(x[uncertain], y[uncertain], marker, color=colour, ms=3.5, mfc="white")
    if hollow:
        label = f"hollow: fewer than {RELIABLE_WAVES} waves"
        axes.plot([], [], "o", color="0.4", ms=3.5, mfc="white", label=label)
    axes.set(xlabel="n_subunit [stitches]", ylabel="wavelength [mm]")
    axes.set_title(f"wavelength along {direction}")
    small: Look = {"fontsize": 6, "title_fontsize": 6, "handletextpad": 0.2}
    axes.legend(loc="upper left", title="slope ± 95 % [mm a stitch]", **small)
    # Room above the lines for the legend.
    axes.set_ylim(0, (2.1 if hollow else 1.7) * axes.get_ylim()[1])
