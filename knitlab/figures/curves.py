"""Curves of tensile tests against applied strain: dashed if measured, broken where fabric snaps."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from knitlab.cubes.cube_file import is_measured, source_of
from knitlab.figures.cells import periods_of, planned_designs
from knitlab.figures.style import STRAIN_LABEL, Look, shades, subplots
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import RUN, Status

BAND = 0.25  # opacity of a band
BREAK = "break: the fabric snaps there"
ENDED = "the test did not converge beyond"


class Row(NamedTuple):
    """A row of curves: its label, and the factor from the unit of the cube to that of the label."""

    label: str
    factor: float = 1.0


def draw_curves(
    cubes: Sequence[xr.Dataset], rows: Mapping[str, Row], legend: tuple[str, str]
) -> Figure:
    """Curves of designs, with a legend in a corner of a variable's panels; colour encodes P."""
    designs = [one for cube in cubes for one in planned_designs(cube) if int(one["status"]) in RUN]
    if not designs:
        raise invalid("designs", "none of this selection has been simulated; run it first")
    stripes = sorted({int(n) for cube in cubes for n in cube["n_stripe"].values})
    periods = np.unique([periods_of(design) for design in designs])
    colours = dict(zip(periods, shades(len(periods)), strict=True))
    figure, grid = subplots(4.9, len(rows), len(stripes), sharex=True, sharey="row", squeeze=False)
    variable, corner = legend
    for column, n_stripe in zip(grid.T, stripes, strict=True):
        for design in designs:
            if int(design["n_stripe"]) == n_stripe:
                _draw_design(column, rows, design, colours[periods_of(design)])
        column[0].set_title(f"n_stripe = {n_stripe}")
        beside = column[list(rows).index(variable)]
        if beside.lines:
            small: Look = {"fontsize": 6, "title_fontsize": 6, "borderpad": 0, "labelspacing": 0.15}
            small["handlelength"] = 1.6 if any(map(is_measured, cubes)) else 1
            beside.legend(title="n_subunit", loc=corner, **small)
        column[-1].set_xlabel(STRAIN_LABEL)
    for axes, row in zip(grid[:, 0], rows.values(), strict=True):
        axes.set_ylabel(row.label)
    for axes in (*grid[0], *grid[-1]):
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    figure.align_ylabels(list(grid[:, 0]))
    if notes := _notes(designs, rows):
        figure.legend(handles=notes, loc="outside lower center", ncols=2)
    return figure


def _notes(designs: Sequence[xr.Dataset], rows: Iterable[str]) -> list[Artist]:
    """Legend entries of what the curves show besides their colour."""
    names = {str(name) for design in designs for name in design.data_vars}
    band: Look = {"facecolor": "0.3", "alpha": BAND, "lw": 0}
    notes: list[Artist] = []
    if any(f"{name}_low" in names for name in rows):
        notes.append(Patch(label="band: range over slightly different fabrics", **band))
    if any(map(is_measured, designs)):
        notes.append(Line2D([], [], color="0.3", ls="--", label="measured"))
    if any(f"{name}_error" in names for name in rows):
        notes.append(Patch(label="band of a measured curve: two standard errors", **band))
    notes += break_note(designs)
    if any(int(design["status"]) == Status.not_converged for design in designs):
        notes.append(Line2D([], [], color="0.3", marker="x", ms=6, ls="", label=ENDED))
    return notes


def _draw_design(
    column: Iterable[Axes], rows: Mapping[str, Row], design: xr.Dataset, colour: Any
) -> None:
    measured = is_measured(design)
    label = f"{int(design['n_subunit'])} (P = {int(periods_of(design))})"
    label += f", {source_of(design)}" if measured else ""
    look: Look = {"color": colour, "ls": "--" if measured else "-", "label": label}
    for axes, (name, row) in zip(column, rows.items(), strict=True):
        if name not in design:
            continue
        curves = [design[name]]
        if f"{name}_error" in design:
            curves += [design[name] + factor * design[f"{name}_error"] for factor in (-2, 2)]
        elif f"{name}_low" in design:
            curves += [design[f"{name}_{end}"] for end in ("low", "high")]
        recorded = np.isfinite(design[name].values)
        scaled = [row.factor * curve.values[recorded] for curve in curves]
        snapped = snapped_before(design)[recorded]
        strain, value, *band = broken(snapped, design[STRAIN].values[recorded], *scaled)
        axes.plot(strain, value, marker="" if measured else ".", ms=3, **look)
        if band:
            axes.fill_between(strain, band[0], band[1], color=colour, alpha=BAND, lw=0)
        if int(design["status"]) == Status.not_converged and recorded.any():
            axes.plot(strain[-1], value[-1], "x", ms=6, color=colour)


def snapped_before(design: xr.Dataset) -> Bool[np.ndarray, " strain"]:
    """Whether a design snapped on the way to each applied strain; nowhere if it is not recorded."""
    if "snapped" not in design:
        return np.zeros(design.sizes[STRAIN], bool)
    return np.asarray(design["snapped"].values == 1)


def broken(
    snapped: Bool[np.ndarray, " strain"], *curves: Float[np.ndarray, " strain"]
) -> list[Float[np.ndarray, " point"]]:
    """Curves that break as lines, by a missing value, on the way to every strain that snapped."""
    before = np.flatnonzero(snapped)
    before = before[before > 0]
    return [np.insert(np.asarray(curve, float), before, np.nan) for curve in curves]


def break_note(designs: Iterable[xr.Dataset]) -> list[Line2D]:
    """Legend entry of the breaks, if there are any."""
    if not any(snapped_before(design)[1:].any() for design in designs):
        return []
    # A piece of line, a gap and a piece of line in the width of a handle.
    return [Line2D([], [], color="0.3", ls=(0, (4.2, 3.3)), label=BREAK)]
