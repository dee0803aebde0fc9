"""What contact changes: ν, reaction force and relaxed size of designs with and without it."""

from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from knitlab.figures.curves import break_note, broken, snapped_before
from knitlab.figures.registry import figure
from knitlab.figures.style import (
    CATEGORY_COLOURS,
    MARKERS,
    STRAIN_LABEL,
    TWO_COLUMNS,
    Look,
    name_rows,
)
from knitlab.io.errors import invalid
from knitlab.observables.schema import DESIGN_DIMS
from knitlab.observables.status import Status

CONTACT = ("none", "barrier")
PEAK = "peak: a jump that contact moves to another strain"
LARGE_STEP = 0.05  # of Poisson's ratio, from a strain to the next
WIDTH_OF_NOTE = 100  # letters
NAMED = 3  # number of curves, those of the largest changes, that have the names of their designs
THROUGH = "#FBE3D0"  # colour behind designs that pass through themselves without contact
NOTE = "relaxed, it passes through itself without contact"
# Name and mark of each size of a relaxed unit cell.
SIZES: dict[str, Look] = {
    "relaxed_cell_x": {"label": "width", "marker": "o", "ms": 4, "ls": ""},
    "relaxed_cell_y": {"label": "length", "marker": "^", "ms": 4.5, "ls": "", "mfc": "none"},
}


@figure(compares=True)
def contact(cube: xr.Dataset) -> Figure:
    """What contact changes in Poisson's ratio, reaction force and relaxed size of every design."""
    if "contact" not in cube.dims or {*CONTACT} - {*map(str, cube["contact"].values)}:
        hint = "run a workflow with both, contact = none,barrier"
        raise invalid("contact", f"compares designs without contact and with it; {hint}")
    stacked = cube.stack(design=DESIGN_DIMS).transpose("design", ...)
    without, touching = (stacked.sel(contact=label) for label in CONTACT)
    planned = (without["status"] != Status.excluded) & (touching["status"] != Status.excluded)
    usable = (without["status"] == Status.ok) & (touching["status"] == Status.ok)
    if not usable.any():
        raise invalid("contact", "no selected design is ok both without contact and with it")
    left_out = ", ".join(map(str, stacked["design"].values[(planned & ~usable).values]))
    without, touching = without.isel(design=usable.values), touching.isel(design=usable.values)
    designs = without["design"].values
    stripes = sorted({n_stripe for n_stripe, _ in designs})
    colour = dict(zip(stripes, CATEGORY_COLOURS, strict=False))
    colours = [colour[n_stripe] for n_stripe, _ in designs]
    height = max(3.6, 1.0 + 0.155 * len(designs))
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    panels = figure.subplot_mosaic([["ratio", "sizes"], ["force", "sizes"]], width_ratios=(1.15, 1))
    ratio, force = panels["ratio"], panels["force"]
    ratio.sharex(force)
    pairs = [
        (without.isel(design=k), touching.isel(design=k)) for k in range(without.sizes["design"])
    ]
    snapped = [snapped_before(one) | snapped_before(other) for one, other in pairs]
    relative = touching["reaction_force"] / without["reaction_force"] - 1
    _draw_changes(ratio, touching["poisson_ratio"] - without["poisson_ratio"], snapped, colours)
    _draw_changes(force, relative, snapped, colours)
    ratio.set_ylabel("change of\nPoisson's ratio [1]")
    ratio.tick_params(labelbottom=False)
    force.set(xlabel=STRAIN_LABEL, ylabel="change of\nreaction force")
    force.yaxis.set_major_formatter(PercentFormatter(1.0))
    handles = [Line2D([], [], color=colour[n], label=f"n_stripe = {n}") for n in stripes]
    handles += _draw_sizes(panels["sizes"], without, touching, colours)
    handles += break_note([one for pair in pairs for one in pair])
    if _has_peak(touching["poisson_ratio"] - without["poisson_ratio"]):
        handles.append(Line2D([], [], ls="", label=PEAK))
    if left_out:
        note = fill(f"not ok without contact or with it: {left_out}", WIDTH_OF_NOTE)
        handles.append(Line2D([], [], ls="", label=note))
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _draw_changes(
    axes: Axes, changes: xr.DataArray, snapped: list[np.ndarray], colours: list[str]
) -> None:
    """Draw the changes over the strain, those of the largest with marks and a name."""
    # Relaxed fabric has neither a Poisson's ratio nor a reaction.
    pulled = changes["applied_strain"].values > 0
    changes = changes.isel(applied_strain=pulled)
    largest = abs(changes).max("applied_strain").fillna(0).values
    leading = np.argsort(-largest, kind="stable")[:NAMED].tolist()
    for k, (curve, colour) in enumerate(zip(changes, colours, strict=True)):
        look: Look = {}
        if k in leading:
            marker = MARKERS[leading.index(k)]
            look = {"label": str(changes["design"].values[k]), "marker": marker, "ms": 3}
        points = broken(snapped[k][pulled], curve["applied_strain"].values, curve.values)
        axes.plot(*points, color=colour, lw=0.9, **look)
    axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    axes.legend(title="largest", title_fontsize=6, fontsize=6)


def _has_peak(changes: xr.DataArray) -> bool:
    """Whether a change differs from those at both neighbouring strains."""
    step = changes.transpose("design", "applied_strain").diff("applied_strain").values
    up, down = step[:, :-1], -step[:, 1:]
    return bool(
        (np.minimum(up, down) > LARGE_STEP).any() or (np.maximum(up, down) < -LARGE_STEP).any()
    )


def _draw_sizes(
    axes: Axes, without: xr.Dataset, touching: xr.Dataset, colours: list[str]
) -> list[Line2D]:
    """Draw the changes of the relaxed sizes; the entries of their legend."""
    through = without["self_intersections"].sel(applied_strain=0).values > 0
    for row in np.flatnonzero(through).tolist():
        axes.axhspan(row - 0.5, row + 0.5, color=THROUGH, lw=0, zorder=0)
    for name, look in SIZES.items():
        change = (touching[name] / without[name] - 1).values
        for row, (value, colour) in enumerate(zip(change, colours, strict=True)):
            axes.plot(value, row, color=colour, **look)
    axes.axvline(0, color="0.7", lw=0.6, zorder=0)
    name_rows(axes, list(map(str, without["design"].values)), fontsize=6.5)
    axes.set_xlabel("change of the relaxed unit cell")
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    axes.xaxis.set_major_locator(MaxNLocator(5))
    handles = [Line2D([], [], color="0.3", **look) for look in SIZES.values()]
    if through.any():
        handles.append(Line2D([], [], marker="s", ms=7, ls="", color=THROUGH, label=NOTE))
    return handles
