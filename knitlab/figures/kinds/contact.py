"""What contact changes: ν, reaction force and relaxed size of designs with and without it."""

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from knitlab.cube.schema import DESIGN_DIMS, Status
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.labels import Label, place_labels
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS
from knitlab.figures.trade_off import Design
from knitlab.io.errors import fault

CONTACT = "contact"
LABELLED = 3
"""Number of curves, those of the largest changes, that have the names of their designs."""
ROW, SMALLEST = 0.155, 3.6
"""Height of the row of a design, and of the smallest figure [in]."""
THROUGH = "#FBE3D0"
"""Colour behind designs that pass through themselves without contact."""
NOTE = "relaxed, it passes through itself without contact"


def contact_effect(cube: xr.Dataset) -> Figure:
    """What contact changes in Poisson's ratio, reaction force and relaxed size of every design.

    Each line and row is a design, with contact compared to without. Rows of designs that pass
    through themselves without contact, when relaxed, are shaded. Designs that are not ok in both
    are left out, and named below.

    Args:
        cube: with designs without contact and with it, as a sweep of ``contact`` gives.

    Raises:
        BadInput: if it does not hold both, or no design is ok in both.
    """
    if CONTACT not in cube.dims or {"none", "barrier"} - {*map(str, cube[CONTACT].values)}:
        raise fault(
            "contact",
            "compares designs without contact and with it; run a workflow with both, contact ="
            " none,barrier",
        )
    stacked = cube.stack(design=DESIGN_DIMS).transpose("design", ...)
    without, touching = (stacked.sel({CONTACT: label}) for label in ("none", "barrier"))
    planned = (without["status"] != Status.excluded) & (touching["status"] != Status.excluded)
    usable = (without["status"] == Status.ok) & (touching["status"] == Status.ok)
    if not usable.any():
        raise fault("contact", "no design of the selection is ok both without contact and with it")
    designs = _named(stacked, usable)
    left_out = _named(stacked, planned & ~usable)
    without, touching = without.isel(design=usable.values), touching.isel(design=usable.values)
    stripes = sorted({n_stripe for n_stripe, _ in designs})
    colours = dict(zip(stripes, CATEGORY_COLOURS, strict=False))
    figure = Figure(
        figsize=(TWO_COLUMNS, max(SMALLEST, 1.0 + ROW * len(designs))), layout="constrained"
    )
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1))
    ratio = figure.add_subplot(grid[0, 0])
    force = figure.add_subplot(grid[1, 0], sharex=ratio)
    size = figure.add_subplot(grid[:, 1])
    # Relaxed fabric has neither a Poisson's ratio nor a reaction.
    pulled = cube["applied_strain"].values > 0
    strain = cube["applied_strain"].values[pulled]
    changes = {
        ratio: (touching["poisson_ratio"] - without["poisson_ratio"]).values[..., pulled],
        force: (touching["reaction_force"] / without["reaction_force"]).values[..., pulled] - 1,
    }
    for axes, curves in changes.items():
        for (n_stripe, _), curve in zip(designs, curves, strict=True):
            axes.plot(strain, curve, color=colours[n_stripe], lw=0.9)
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    ratio.set_ylabel("change of\nPoisson's ratio [1]")
    ratio.tick_params(labelbottom=False)
    force.set(xlabel="applied strain [1]", ylabel="change of\nreaction force")
    force.yaxis.set_major_formatter(PercentFormatter(1.0))
    _sizes(size, designs, without, touching, colours)
    handles = [
        Line2D([], [], color=colours[n_stripe], label=f"n_stripe = {n_stripe}")
        for n_stripe in stripes
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    if left_out:
        names = ", ".join(map(str, left_out))
        figure.supxlabel(f"not ok without contact or with it: {names}", fontsize=7)
    for axes, curves in changes.items():
        place_labels(figure, axes, _labels(designs, strain, curves))
    return figure


def _labels(
    designs: list[Design],
    strain: Float[np.ndarray, " strain"],
    curves: Float[np.ndarray, "design strain"],
) -> list[Label]:
    """The largest changes, by the names of their designs at the strain of the change."""
    found = [
        (abs(curve[place]), Label(float(strain[place]), float(curve[place]), f"{design}"))
        for design, curve in zip(designs, curves, strict=True)
        if np.isfinite(curve).any()
        for place in [int(np.nanargmax(abs(curve)))]
    ]
    return [label for _, label in sorted(found, key=lambda each: -each[0])[:LABELLED]]


def _named(stacked: xr.Dataset, kept: xr.DataArray) -> list[Design]:
    return [(int(n), int(m)) for n, m in stacked["design"].values[kept.values]]


def _sizes(
    axes: Axes,
    designs: list[Design],
    without: xr.Dataset,
    touching: xr.Dataset,
    colours: dict[int, str],
) -> None:
    """Change of the relaxed unit cell along both axes, a row for each design."""
    through = without["self_intersections"].sel(applied_strain=0).values > 0
    change = {
        axis: (touching[name] / without[name] - 1).values
        for axis, name in (("x", "relaxed_cell_x"), ("y", "relaxed_cell_y"))
    }
    for row, (n_stripe, _) in enumerate(designs):
        if through[row]:
            axes.axhspan(row - 0.5, row + 0.5, color=THROUGH, lw=0, zorder=0)
        colour = colours[n_stripe]
        axes.plot(change["x"][row], row, "o", ms=4, color=colour)
        axes.plot(change["y"][row], row, "^", ms=4.5, mfc="none", color=colour)
    axes.axvline(0, color="0.7", lw=0.6, zorder=0)
    axes.set(
        yticks=range(len(designs)),
        yticklabels=[f"{design}" for design in designs],
        ylim=(len(designs) - 0.5, -0.5),
        xlabel="change of the relaxed unit cell",
    )
    axes.tick_params(axis="y", length=0, labelsize=6.5)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    shade = Line2D([], [], marker="s", ms=7, ls="", color=THROUGH, label=NOTE)
    marks = [
        Line2D([], [], marker="o", ms=4, ls="", color="0.3", label="width"),
        Line2D([], [], marker="^", ms=4.5, mfc="none", ls="", color="0.3", label="length"),
    ]
    axes.legend(
        handles=[*marks, shade] if through.any() else marks,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=2,
        frameon=False,
        fontsize=6.5,
    )


FIGURE = FigureKind(contact_effect)
