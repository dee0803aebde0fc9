"""Curves of tensile tests against applied strain: dashed if measured, broken where fabric snaps."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from knitlab.cubes.cube_file import is_measured, source_of
from knitlab.figures.cells import not_run, periods_of, planned_designs
from knitlab.figures.style import (
    MARKERS,
    ONE_COLUMN,
    STRAIN_LABEL,
    TWO_COLUMNS,
    Look,
    shades,
    subplots,
)
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import RUN, Status

BAND = 0.25  # opacity of a band
BREAK = "break: the fabric snaps there"
ENDED = "the test did not converge beyond"
NEGLIGIBLE = 1e-9  # value that is zero but for round-off
MAX_RANGE_RATIO = 3.0  # ratio of the ranges of panels up to which they share an axis


class Row(NamedTuple):
    """A row of curves: its label, and the factor from the unit of the cube to that of the label."""

    label: str
    factor: float = 1.0


def draw_curves(
    cubes: Sequence[xr.Dataset], rows: Mapping[str, Row], legend: tuple[str, str]
) -> Figure:
    """Curves of designs, with a legend in a corner of a variable's panels; P has colour and mark.

    Rows and columns that no design has are left out. Panels of a row share their axis, unless one
    would be flat.
    """
    designs = [one for cube in cubes for one in planned_designs(cube) if int(one["status"]) in RUN]
    rows = {name: row for name, row in rows.items() if _has(designs, name)}
    designs = [design for design in designs if any(_has([design], name) for name in rows)]
    if not designs:
        raise not_run()
    stripes = sorted({int(design["n_stripe"]) for design in designs})
    periods = np.unique([periods_of(design) for design in designs])
    looks = [
        {"color": colour, "marker": marker}
        for colour, marker in zip(shades(len(periods)), MARKERS * len(periods), strict=False)
    ]
    of_periods = dict(zip(periods, looks, strict=False))
    width = TWO_COLUMNS if len(stripes) > 1 else 1.2 * ONE_COLUMN
    size: Look = {"width": width, "squeeze": False, "sharex": True}
    figure, grid = subplots(0.4 + 1.5 * len(rows), len(rows), len(stripes), **size)
    variable, corner = legend
    for column, n_stripe in zip(grid.T, stripes, strict=True):
        for design in designs:
            if int(design["n_stripe"]) == n_stripe:
                _draw_design(column, rows, design, of_periods[periods_of(design)])
        column[0].set_title(f"n_stripe = {n_stripe}")
        small: Look = {"fontsize": 6, "title_fontsize": 6, "borderpad": 0, "labelspacing": 0.15}
        small["handlelength"] = 1.6 if any(map(is_measured, cubes)) else 1
        beside = [*rows].index(variable) if variable in rows else -1
        column[beside].legend(title="n_subunit", loc=corner, **small)
        column[-1].set_xlabel(STRAIN_LABEL)
    for axes in (*grid[0], *grid[-1]):
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    for panels, row in zip(grid, rows.values(), strict=True):
        panels[0].set_ylabel(row.label)
        _share(panels)
    figure.align_ylabels(list(grid[:, 0]))
    if notes := _notes(designs, rows):
        figure.legend(handles=notes, loc="outside lower center", ncols=2)
    return figure


def _has(designs: Iterable[xr.Dataset], name: str) -> bool:
    return any(name in one and (abs(one[name]) > NEGLIGIBLE).any() for one in designs)


def _share(panels: Sequence[Axes]) -> None:
    """Give panels side by side one axis, unless a curve would fill little of it."""
    heights = [np.ptp(panel.get_ylim()) for panel in panels]
    if max(heights) <= MAX_RANGE_RATIO * min(heights):
        for panel in panels[1:]:
            panel.sharey(panels[0])
            panel.tick_params(labelleft=False)
        panels[0].autoscale()


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
    column: Iterable[Axes], rows: Mapping[str, Row], design: xr.Dataset, marked: Look
) -> None:
    measured = is_measured(design)
    label = f"{int(design['n_subunit'])} (P = {int(periods_of(design))})"
    label += f", {source_of(design)}" if measured else ""
    look: Look = {"ls": "--" if measured else "-", "label": label, "ms": 2.4} | marked
    colour = marked["color"]
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
        axes.plot(strain, value, **look | ({"marker": ""} if measured else {}))
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
