"""Tension curves: ε_xx, ε_yy and ν against applied strain, a column for each n_stripe."""

from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from knitlab.cube.cube_file import is_measured, source_of
from knitlab.cube.schema import RUN, Status
from knitlab.figures.cells import values_of
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.snaps import break_note, broken, snapped_before
from knitlab.figures.sources import lines_of, on_one_grid
from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.figures.value_colours import Colour
from knitlab.io.errors import fault

BAND = 0.25
"""Opacity of a band."""
HEIGHT = 4.9
"""Height of the figure [in]."""
ROWS = {
    "mean_strain_xx": "transverse strain\nmean $\\varepsilon_{xx}$ [1]",
    "mean_strain_yy": "axial strain\nmean $\\varepsilon_{yy}$ [1]",
    "poisson_ratio": "Poisson's ratio\n$\\nu$ [1]",
}


def tension_curves(cubes: Sequence[xr.Dataset]) -> Figure:
    """ε_xx, ε_yy and ν against applied strain (paper, Fig. "tension plots").

    Colour encodes P, the periods in a patch, in every column. Measured curves are dashed, with a
    band of two standard errors; the band of a simulated curve is the range of its siblings. A curve
    breaks where the fabric snaps; a test that did not reach its last strain ends in a cross.

    Raises:
        BadInput: if no design has been simulated or measured.
    """
    if not any(cube["status"].isin(RUN).any() for cube in cubes):
        raise fault("curves", "no design of this selection has been simulated; run it first")
    if not any(name in cube for cube in cubes for name in ROWS):
        raise fault("curves", "shows strains, and no cube has any; import markers")
    gridded = on_one_grid(cubes)
    stripes = gridded[0]["n_stripe"].values
    figure = Figure(figsize=(TWO_COLUMNS, HEIGHT), layout="constrained")
    grid = figure.subplots(len(ROWS), len(stripes), sharex=True, sharey="row", squeeze=False)
    periods = np.unique(values_of(cubes, "periods"))
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.8, len(periods)))
    colours = dict(zip(periods, shades, strict=True))
    drawn = []

    for column, n_stripe in enumerate(stripes):
        for cube in gridded:
            family = cube.sel(n_stripe=n_stripe)
            for n_subunit in family["n_subunit"].values[family["status"].isin(RUN).values]:
                design = family.sel(n_subunit=n_subunit)
                _draw_design(grid[:, column], design, colours[float(design["periods"])])
                drawn.append(design)
        grid[0, column].set_title(f"n_stripe = {n_stripe}")
        # Axial strain follows the diagonal, so that this corner is free.
        if grid[1, column].lines:
            grid[1, column].legend(
                title="n_subunit",
                loc="lower right",
                frameon=False,
                handlelength=1.6 if any(map(is_measured, cubes)) else 1,
                borderpad=0,
                fontsize=6,
                title_fontsize=6,
                labelspacing=0.15,
            )
        grid[-1, column].set_xlabel("applied strain [1]")
    for axes, label in zip(grid[:, 0], ROWS.values(), strict=True):
        axes.set_ylabel(label)
    for axes in (*grid[0], *grid[-1]):
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    figure.align_ylabels(list(grid[:, 0]))
    if notes := _notes(drawn):
        figure.legend(handles=notes, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _notes(designs: Sequence[xr.Dataset]) -> list[Artist]:
    """Legend entries of what the curves show besides their colour."""
    notes: list[Artist] = []
    if any(f"{name}_low" in design for design in designs for name in ROWS):
        label = "band: range over slightly different fabrics"
        notes.append(Patch(facecolor="0.3", alpha=BAND, lw=0, label=label))
    if any(map(is_measured, designs)):
        notes.append(Line2D([], [], color="0.3", ls="--", label="measured"))
    if any(f"{name}_error" in design for design in designs for name in ROWS):
        label = "band of a measured curve: two standard errors"
        notes.append(Patch(facecolor="0.3", alpha=BAND, lw=0, label=label))
    notes += break_note(designs)
    if any(int(design["status"]) == Status.not_converged for design in designs):
        label = "the test did not converge beyond"
        notes.append(Line2D([], [], color="0.3", marker="x", ms=6, ls="", label=label))
    return notes


def _draw_design(rows: Iterable[Axes], design: xr.Dataset, colour: Colour) -> None:
    measured = is_measured(design)
    label = f"{int(design['n_subunit'])} (P = {int(design['periods'])})"
    if measured:
        label += f", {source_of(design)}"
    look: dict[str, Any] = {"color": colour, "ls": lines_of(design), "label": label}
    strains, snapped = design["applied_strain"].values, snapped_before(design)
    for axes, name in zip(rows, ROWS, strict=True):
        if name not in design:
            continue
        values = design[name].values
        recorded = np.isfinite(values)
        curves = [strains, values, *_edges(design, name)]
        curve = broken(snapped[recorded], *(each[recorded] for each in curves))
        axes.plot(*curve[:2], marker="" if measured else ".", ms=3, **look)
        if len(curve) == 4:
            axes.fill_between(curve[0], curve[2], curve[3], color=colour, alpha=BAND, lw=0)
        if int(design["status"]) == Status.not_converged and recorded.any():
            axes.plot(curve[0][-1], curve[1][-1], "x", ms=6, color=colour)


def _edges(design: xr.Dataset, name: str) -> list[np.ndarray]:
    """Lower and upper edge of the band of a curve, if it has one."""
    if f"{name}_error" in design:
        error = 2 * design[f"{name}_error"]
        return [(design[name] - error).values, (design[name] + error).values]
    if f"{name}_low" in design:
        return [design[f"{name}_{end}"].values for end in ("low", "high")]
    return []


FIGURE = FigureKind(tension_curves, coordinates=("applied_strain",), several="experiments")
