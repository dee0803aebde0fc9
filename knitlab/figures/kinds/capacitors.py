"""Capacitors side by side: their curves and slopes (paper, Fig. "capacitor testing").

It takes several cubes because pure stripes and checkerboards are in different ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knitlab.cube.cube_file import base_dims, is_measured, source_of
from knitlab.cube.schema import DESIGN_DIMS, RUN
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.snaps import break_note, broken, snapped_before
from knitlab.figures.sources import lines_of
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS
from knitlab.io.errors import fault
from knitlab.measure.capacitance.capacitor_status import CapacitorStatus
from knitlab.measure.capacitance.sensor import CENTRAL_PART

SLOPE: dict[str, Any] = {"lw": 4, "alpha": 0.45, "solid_capstyle": "butt"}
END: dict[str, Any] = {"marker": "|", "ms": 9, "mew": 1.5, "ls": ""}
BACK: dict[str, Any] = {"marker": ".", "ms": 3, "mfc": "none", "ls": ""}
INK = "0.3"
LINES = ("-", "--", "-.", (0, (1, 1)))
PAPER_STRIPES = (("rib", 4), ("garter", 4))
PAPER_CHECKERBOARDS = ((4, 16), (4, 32))
HEIGHT = 3.1
"""Height of the figure [in]."""


@dataclass(frozen=True)
class Sample:
    """One fabric with electrodes.

    Attributes:
        name: its name in the figure.
        cell: one cell of a cube.
    """

    name: str
    cell: xr.Dataset


def capacitors_figure(cubes: Sequence[xr.Dataset]) -> Figure:
    """C/C0 against applied strain, and the slopes, side by side (paper, Fig. "capacitor testing").

    Shows those of the paper's four samples that the cubes hold, and all measured ones. Thick lines
    mark the central 20 % over which the slope is averaged; dots are unloading. There is no curve
    where electrodes touch or the model passes through itself.

    Raises:
        BadInput: if no cube holds one of the samples with electrodes.
    """
    samples = [sample for cube in cubes for sample in _samples(cube)]
    if not samples:
        raise fault(
            "capacitors",
            "shows 4 × 4 rib and garter, (4, 16) and (4, 32) with electrodes, and no cube has one;"
            " give cubes of the workflows sensor and sensor_stripes",
        )
    figure = Figure(figsize=(TWO_COLUMNS, HEIGHT), layout="constrained")
    curves, absolute, slopes = figure.subplots(1, 3, width_ratios=(1.3, 1.3, 0.9))
    any_measured = any(is_measured(sample.cell) for sample in samples)
    coloured = list(zip(samples, CATEGORY_COLOURS, strict=False))
    dashes = iter(LINES * 2)
    for sample, colour in coloured:
        # Dashes mark measured samples, if there are any.
        line = lines_of(sample.cell) if any_measured else next(dashes)
        _curve(curves, sample, "capacitance_ratio", colour, line)
        _curve(absolute, sample, "capacitance", colour, line)
    curves.set(xlabel="applied strain [1]", ylabel="$C/C_0$ [1]")
    lengths = [
        float(sample.cell["electrode_length"])
        for sample in samples
        if "electrode_length" in sample.cell
    ]
    simulated = "simulated " if any_measured else ""
    note = f"\n{simulated}electrodes of {max(lengths):.0f} mm" if lengths else ""
    absolute.set(xlabel="applied strain [1]", ylabel=f"$C$ [pF]{note}")
    positions = np.arange(len(samples))
    values = [float(sample.cell["sensitivity"]) for sample in samples]
    bars = slopes.bar(positions, np.nan_to_num(values), color=[colour for _, colour in coloured])
    slopes.bar_label(bars, [f"{value:.2f}" if np.isfinite(value) else "none" for value in values])
    slopes.set_xticks(positions, [sample.name for sample in samples], rotation=40, ha="right")
    slopes.margins(y=0.1)
    slopes.set_ylabel("mean slope |d$C$/dε| [pF]")
    handles = [*curves.get_legend_handles_labels()[0], *_notes(samples)]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _notes(samples: Sequence[Sample]) -> list[Line2D]:
    """Legend entries of the marks on the curves."""
    within = f"central {CENTRAL_PART:.0%} of the range: mean slope"
    notes = [
        Line2D([], [], **SLOPE, color=INK, label=within),
        Line2D([], [], **END, color=INK, label="end of the range"),
    ]
    if any(np.isfinite(_unloading(sample.cell, "capacitance")).any() for sample in samples):
        notes.append(Line2D([], [], **BACK, color=INK, label="unloading, where it differs"))
    return [*notes, *break_note(sample.cell for sample in samples)]


def _curve(axes: Axes, sample: Sample, name: str, colour: str, line: object) -> None:
    cell = sample.cell
    strain, values = cell["applied_strain"].values, cell[name].values
    curve = broken(snapped_before(cell), strain, values)
    axes.plot(*curve, color=colour, ls=line, lw=1.0, label=sample.name)
    start, end = float(cell["applied_strain_opened"]), float(cell["sensing_end"])
    finite = np.isfinite(values)
    if np.isfinite(start) and finite.any():
        middle, half = (start + end) / 2, CENTRAL_PART / 2 * (end - start)
        within = np.linspace(middle - half, middle + half, 20)
        axes.plot(
            within,
            np.interp(within, strain[finite], values[finite]),
            color=colour,
            **SLOPE,
        )
        axes.plot(end, np.interp(end, strain[finite], values[finite]), color=colour, **END)
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


def _samples(cube: xr.Dataset) -> list[Sample]:
    if "capacitance" not in cube:
        return []
    wanted: list[tuple[str, dict[str, int | str]]]
    if base_dims(cube) == DESIGN_DIMS:
        wanted = [(f"({n}, {m})", {"n_stripe": n, "n_subunit": m}) for n, m in PAPER_CHECKERBOARDS]
    else:
        wanted = [
            (f"{n} × {n} {knit}", {"knit": knit, "n": n, "boundary": boundary})
            for knit, n in PAPER_STRIPES
            for boundary in cube["boundary"].values[:1]
        ]
    found = []
    if is_measured(cube):
        wanted = [
            (f"({n}, {m}) {source_of(cube)}", {"n_stripe": n, "n_subunit": m})
            for n in cube["n_stripe"].values.tolist()
            for m in cube["n_subunit"].values.tolist()
        ]
    for name, labels in wanted:
        if all(value in cube[dim].values for dim, value in labels.items()):
            cell = cube.sel(labels)
            measured = (cell["capacitor_status"] == CapacitorStatus.measured).any()
            if int(cell["status"]) in RUN and measured:
                found.append(Sample(name, cell))
    return found


FIGURE = FigureKind(capacitors_figure, dims=None, several="any")
