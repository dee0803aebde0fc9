"""Tension curves: ε_xx, ε_yy and ν against applied strain, a column for each n_stripe."""

from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.cells import Colour, values_of
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.sources import lines_of, on_one_grid
from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.io.cube_file import is_measured, source_of
from knitlab.io.design_status import RUN, Status
from knitlab.io.errors import fault

ENDS = ("low", "high")
ROWS = {
    "mean_strain_xx": "transverse strain\nmean $\\varepsilon_{xx}$ [1]",
    "mean_strain_yy": "axial strain\nmean $\\varepsilon_{yy}$ [1]",
    "poisson_ratio": "Poisson's ratio\n$\\nu$ [1]",
}


def tension_curves(cubes: Sequence[xr.Dataset]) -> Figure:
    """ε_xx, ε_yy and ν against applied strain (paper, Fig. "tension plots").

    Colour encodes P, the periods in a patch, in every column. Measured curves are dashed, with a
    band of two standard errors; the band of a simulated curve is the range of its siblings. A test
    that did not reach its last strain ends in a cross.

    Raises:
        BadInput: if no design has been simulated or measured.
    """
    if not any(cube["status"].isin(RUN).any() for cube in cubes):
        raise fault("curves", "no design of this selection has been simulated; run it first")
    if not any(name in cube for cube in cubes for name in ROWS):
        raise fault("curves", "shows strains, and no cube has any; import markers")
    gridded = on_one_grid(cubes)
    stripes = gridded[0]["n_stripe"].values
    figure = Figure(figsize=(TWO_COLUMNS, 4.6), layout="constrained")
    grid = figure.subplots(len(ROWS), len(stripes), sharex=True, sharey="row", squeeze=False)
    periods = np.unique(values_of(cubes, "periods"))
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.8, len(periods)))
    colours = dict(zip(periods, shades, strict=True))

    for column, n_stripe in enumerate(stripes):
        for cube in gridded:
            family = cube.sel(n_stripe=n_stripe)
            for n_subunit in family["n_subunit"].values[family["status"].isin(RUN).values]:
                design = family.sel(n_subunit=n_subunit)
                _draw_design(grid[:, column], design, colours[float(design["periods"])])
        grid[0, column].set_title(f"n_stripe = {n_stripe}")
        # Axial strain follows the diagonal, so that this corner is free.
        if grid[1, column].lines:
            grid[1, column].legend(
                title="n_subunit",
                loc="lower right",
                frameon=False,
                handlelength=1.5 if any(map(is_measured, cubes)) else 1,
                borderpad=0,
                fontsize=5.5,
                title_fontsize=6,
                labelspacing=0.15,
            )
        grid[-1, column].set_xlabel("applied strain [1]")
    for axes, label in zip(grid[:, 0], ROWS.values(), strict=True):
        axes.set_ylabel(label)
    for axes in (*grid[0], *grid[-1]):
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    figure.align_ylabels(list(grid[:, 0]))
    return figure


def _draw_band(axes: Axes, low: xr.DataArray, high: xr.DataArray, colour: Colour) -> None:
    axes.fill_between(low["applied_strain"], low, high, color=colour, alpha=0.25, lw=0)


def _draw_design(rows: Iterable[Axes], design: xr.Dataset, colour: Colour) -> None:
    measured = is_measured(design)
    label = f"{int(design['n_subunit'])} (P = {int(design['periods'])})"
    if measured:
        label += f", {source_of(design)}"
    look: dict[str, Any] = {"color": colour, "ls": lines_of(design), "label": label}
    for axes, name in zip(rows, ROWS, strict=True):
        if name not in design:
            continue
        curve = design[name].dropna("applied_strain")
        axes.plot(curve["applied_strain"], curve, marker="" if measured else ".", ms=3, **look)
        strain = curve["applied_strain"]
        if f"{name}_error" in design:
            error = 2 * design[f"{name}_error"].sel(applied_strain=strain)
            _draw_band(axes, curve - error, curve + error, colour)
        elif f"{name}_low" in design:
            low, high = (design[f"{name}_{end}"].sel(applied_strain=strain) for end in ENDS)
            _draw_band(axes, low, high, colour)
        if int(design["status"]) == Status.not_converged and curve.size:
            axes.plot(curve["applied_strain"][-1], curve[-1], "x", ms=6, color=colour)


FIGURE = FigureKind(tension_curves, coordinates=("applied_strain",), several="experiments")
