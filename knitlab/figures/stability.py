"""Branches of equilibria and relaxed shapes of one design."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from knitlab.figures.cells import number_table
from knitlab.figures.style import (
    CATEGORY_COLOURS,
    ONE_COLUMN,
    STRAIN_COLOURS,
    STRAIN_LABEL,
    TWO_COLUMNS,
    Look,
    subplots,
)

MARKS = {"limit": ("^", "limit point: it snaps"), "branch": ("o", "branch point")}
SHOWN = 6  # shapes
MICROJOULES = 1e3  # in N mm


def branches_figure(points: xr.Dataset) -> Figure:
    """Force and lowest eigenvalue along branches, solid where stable, against the strain."""
    figure, (force, eigenvalue) = subplots(3.2, 1, 2)
    strain = points["applied_strain"].values
    for axes, name, label in (
        (force, "reaction_force", "reaction force [N]"),
        (eigenvalue, "lowest_eigenvalue", "lowest eigenvalue [N/mm]"),
    ):
        axes.set(xlabel=STRAIN_LABEL, ylabel=label)
        values = points[name].values
        branches = np.unique(points["branch"])
        # The first are the widest, so that none hides another.
        for branch, width in zip(branches, np.linspace(3, 1, len(branches)), strict=True):
            own = points["branch"].values == branch
            colour = CATEGORY_COLOURS[int(branch - 1) % len(CATEGORY_COLOURS)]
            unstable = points["unstable"].values[own] > 0
            axes.plot(strain[own], values[own], ":", color=colour, lw=0.7 * width)
            solid = np.where(unstable, np.nan, values[own])
            axes.plot(strain[own], solid, color=colour, lw=width, label=f"branch {branch}")
        for kind, (marker, label) in MARKS.items():
            at = points["kind"].values == kind
            if at.any():
                axes.plot(strain[at], values[at], marker, color="black", ms=4, label=label)
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    figure.legend(*force.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(f"{points.attrs['design']}; dotted: unstable", fontsize="small")
    return figure


def shapes_figure(shapes: xr.Dataset) -> Figure:
    """Relaxed shapes: the lowest, how others differ from it, and the energies between them."""
    few = shapes.isel(shape=slice(SHOWN), to=slice(SHOWN))
    count = few.sizes["shape"]
    size = (TWO_COLUMNS, 4.0) if count > 1 else (ONE_COLUMN, 2.6)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.add_gridspec(2 if count > 1 else 1, count, height_ratios=(1.1, 1)[:count])
    panels = [figure.add_subplot(grid[0, k]) for k in range(count)]
    lowest, *others = few["height"].values
    periodic = "length_x" in shapes
    apart = [each - _nearest(lowest, each, shifted=periodic) for each in others]
    drawn: list[tuple[list[Axes], list[np.ndarray], str]] = [(panels[:1], [lowest], "height [mm]")]
    drawn += [(panels[1:], apart, "height, less\nthat of shape 1 [mm]")] if apart else []
    for together, heights, label in drawn:
        largest = max(float(abs(each).max()) for each in heights)
        look: Look = {"origin": "lower", "cmap": STRAIN_COLOURS, "vmin": -largest, "vmax": largest}
        for panel, height in zip(together, heights, strict=True):
            image = panel.imshow(height, **look)
        figure.colorbar(image, ax=together, label=label, shrink=0.8)
    for k, panel in enumerate(panels):
        one = few.isel(shape=k)
        panel.set(xticks=[], yticks=[])
        more = MICROJOULES * float(one["energy"] - shapes["energy"][0])
        panel.set_title(
            f"shape {int(one['shape'])}\n+{more:.3g} µJ, {int(one['starts'])} starts", fontsize=7
        )
    left = f"; {shapes.sizes['shape'] - count} more" if shapes.sizes["shape"] > count else ""
    figure.suptitle(f"relaxed shapes of {shapes.attrs['design']}{left}", fontsize="small")
    if count > 1:
        axes, barrier = figure.add_subplot(grid[1, :]), MICROJOULES * few["barrier"]
        barrier = barrier.where(~np.eye(count, dtype=bool))
        # Light enough for black text.
        light = ScalarMappable(Normalize(0, 2 * max(float(barrier.max()), 1e-9)), "Blues")
        number_table(axes, barrier, "shape", "to", light)
        title = "estimated energy to go from one to another [µJ]"
        axes.set(ylabel="from shape", xlabel="to shape", title=title)
    return figure


def _nearest(height: np.ndarray, to: np.ndarray, *, shifted: bool) -> np.ndarray:
    """A height field mirrored, turned over and, if periodic, shifted to be nearest to another."""
    best = height
    for mirrored in (height, height[::-1], height[:, ::-1], height[::-1, ::-1]):
        for field in (mirrored, -mirrored):
            moved = field
            if shifted:
                overlap = np.fft.ifft2(np.fft.fft2(to) * np.fft.fft2(field).conj()).real
                shift = np.unravel_index(int(overlap.argmax()), overlap.shape)
                moved = np.roll(field, shift, axis=(0, 1))
            best = min(best, moved, key=lambda each: float(((each - to) ** 2).sum()))
    return best
