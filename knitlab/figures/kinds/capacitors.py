"""Capacitors side by side: their curves and slopes (paper, Fig. "capacitor testing")."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knitlab.cubes.cube_file import base_dims, is_measured, source_of
from knitlab.figures.curves import break_note, broken, snapped_before
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, STRAIN_LABEL, Look, subplots
from knitlab.io.errors import invalid
from knitlab.observables.capacitance.sensor import CENTRAL_PART, CapacitorStatus
from knitlab.observables.status import RUN

SLOPE: Look = {"lw": 4, "alpha": 0.45, "solid_capstyle": "butt"}
END: Look = {"marker": "|", "ms": 9, "mew": 1.5, "ls": ""}
BACK: Look = {"marker": ".", "ms": 3, "mfc": "none", "ls": ""}
INK = "0.3"
DASHES = ("-", "--", "-.", (0, (1, 1)))
PAPER_SAMPLES = (("rib", 4), ("garter", 4), (4, 16), (4, 32))


@figure(dims=None, several="any")
def capacitors(cubes: Sequence[xr.Dataset]) -> Figure:
    """C/C0 against applied strain, and the slopes, side by side (paper, Fig. "capacitor testing").

    Shows those of the paper's four samples that the cubes hold, and all measured ones. There is no
    curve where electrodes touch or the model passes through itself.
    """
    samples = [sample for cube in cubes for sample in _samples(cube)]
    if not samples:
        shown = "shows 4 × 4 rib and garter, (4, 16) and (4, 32) with electrodes"
        hint = "give cubes of the workflows sensor and sensor_stripes"
        raise invalid("capacitors", f"{shown}, and no cube has one; {hint}")
    figure, (ratios, absolute, slopes) = subplots(3.1, 1, 3, width_ratios=(1.3, 1.3, 0.9))
    cells = [cell for _, cell in samples]
    any_measured = any(map(is_measured, cells))
    for (label, cell), colour, dashes in zip(samples, CATEGORY_COLOURS, DASHES * 2, strict=False):
        # Dashes mark measured samples, if there are any.
        style = "--" if is_measured(cell) else "-"
        look: Look = {"ls": style if any_measured else dashes, "label": label}
        _draw_curve(ratios, cell, "capacitance_ratio", colour, look)
        _draw_curve(absolute, cell, "capacitance", colour, look)
    lengths = [float(cell["electrode_length"]) for cell in cells if "electrode_length" in cell]
    simulated = "simulated " if any_measured else ""
    note = f"\n{simulated}electrodes of {max(lengths):.0f} mm" if lengths else ""
    ratios.set(xlabel=STRAIN_LABEL, ylabel="$C/C_0$ [1]")
    absolute.set(xlabel=STRAIN_LABEL, ylabel=f"$C$ [pF]{note}")
    values = [float(cell["sensitivity"]) for cell in cells]
    colours = CATEGORY_COLOURS[: len(cells)]
    bars = slopes.bar(range(len(cells)), np.nan_to_num(values), color=colours)
    slopes.bar_label(bars, [f"{value:.2f}" if np.isfinite(value) else "none" for value in values])
    slopes.set_xticks([])  # their colours are those of the curves
    slopes.margins(y=0.1)
    slopes.set_ylabel("mean slope |d$C$/dε| [pF]")
    within = f"central {CENTRAL_PART:.0%} of the range: mean slope"
    handles = [
        *ratios.get_legend_handles_labels()[0],
        Line2D([], [], **SLOPE, color=INK, label=within),
        Line2D([], [], **END, color=INK, label="end of the range"),
    ]
    if any(np.isfinite(_unloading(cell, "capacitance")).any() for cell in cells):
        handles.append(Line2D([], [], **BACK, color=INK, label="unloading, where it differs"))
    handles += break_note(cells)
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _draw_curve(axes: Axes, cell: xr.Dataset, name: str, colour: str, look: Look) -> None:
    strain, values = cell["applied_strain"].values, cell[name].values
    axes.plot(*broken(snapped_before(cell), strain, values), color=colour, lw=1.0, **look)
    start, end = float(cell["applied_strain_opened"]), float(cell["sensing_end"])
    finite = np.isfinite(values)
    if np.isfinite(start) and finite.any():
        middle, half = (start + end) / 2, CENTRAL_PART / 2 * (end - start)
        within = np.linspace(middle - half, middle + half, 20)
        for strains, mark in ((within, SLOPE), (np.array([end]), END)):
            at = np.interp(strains, strain[finite], values[finite])
            axes.plot(strains, at, color=colour, **mark)
    axes.plot(strain, _unloading(cell, name), color=colour, **BACK)


def _unloading(cell: xr.Dataset, name: str) -> np.ndarray:
    """A capacitance, or its ratio, during unloading; missing where it is as during loading."""
    values, loading = cell[name].values, cell["capacitance"].values
    finite = np.isfinite(values)
    if "capacitance_unloading" not in cell or not finite.any():
        return np.full(len(values), np.nan)
    back = cell["capacitance_unloading"].values * values[finite][0] / loading[finite][0]
    apart = np.abs(back - values) > 1e-3 * np.abs(back)
    return np.where(apart | (np.isfinite(back) & ~finite), back, np.nan)


def _samples(cube: xr.Dataset) -> list[tuple[str, xr.Dataset]]:
    """The names and cells of the samples of a cube that have measured capacitances to show."""
    if "capacitance" not in cube:
        return []
    samples = []
    first_boundary = cube.isel(boundary=[0]) if "boundary" in cube.dims else cube
    stacked = first_boundary.stack(sample=base_dims(cube))
    source = f" {source_of(cube)}" if is_measured(cube) else ""
    for labels in stacked["sample"].values:
        cell, (first, second) = stacked.sel(sample=labels), labels[:2]
        name = f"{second} × {second} {first}" if isinstance(first, str) else f"({first}, {second})"
        read = (cell["capacitor_status"] == CapacitorStatus.measured).any()
        if (source or labels[:2] in PAPER_SAMPLES) and int(cell["status"]) in RUN and read:
            samples.append((name + source, cell))
    return samples
