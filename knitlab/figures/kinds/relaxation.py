"""The relaxation by dynamics: kinetic energy against time, and snapshots."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.perspective import (
    design_text,
    draw_sheet,
    frame_sheet,
    snapshot_nodes,
    time_text,
)
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS

CONTRACTED = (0.0, 0.15, 0.5)
"""Fractions of the in-plane contraction at which snapshots are shown, before the last one."""
LETTERS = "abcdefgh"
BEFORE_FIRST = 0.7
"""Start of the time axis, which is logarithmic, over the first time after 0."""


def relaxation_figure(case: xr.Dataset) -> Figure:
    """Kinetic energy against time, and snapshots (paper, Fig. "unit simulation").

    Args:
        case: contents of a case file with the history of its relaxation.
    """
    nodes = snapshot_nodes(case)
    chosen = _chosen_snapshots(nodes)
    times = case["snapshot"].values[chosen]
    figure = Figure(figsize=(TWO_COLUMNS, 4.2))
    axes = figure.add_axes((0.085, 0.52, 0.9, 0.42))
    _draw_energies(axes, case)
    for letter, time in zip(LETTERS, times, strict=False):
        at = max(time, axes.get_xlim()[0])
        axes.axvline(at, color="0.75", lw=0.6, zorder=0)
        axes.annotate(
            letter,
            (at, 1),
            (2, -2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            va="top",
        )
    width = 1 / len(chosen)
    for column, (place, letter) in enumerate(zip(chosen, LETTERS, strict=False)):
        scene = figure.add_axes((column * width, 0.0, width, 0.36), projection="3d")
        draw_sheet(scene, nodes[place])
        frame_sheet(scene, nodes)
        middle = (column + 0.5) * width
        figure.text(middle, 0.37, f"{letter}: {time_text(times[column])}", ha="center")
    figure.text(0.5, 0.97, design_text(case), ha="center")
    return figure


def _draw_energies(axes: Axes, case: xr.Dataset) -> None:
    time, kinetic = case["time"].values, case["kinetic_energy"].values
    stored = case["potential_energy"].values
    excess = stored - stored[-1]
    axes.loglog(time[1:], kinetic[1:], color=CATEGORY_COLOURS[0], label="kinetic energy $T$")
    axes.loglog(
        time[1:-1], excess[1:-1], "--", color="0.45", label="elastic energy above the relaxed state"
    )
    axes.set(
        xlabel="time since the flat sheet was released [ms]",
        ylabel="energy [N mm]",
        xlim=(BEFORE_FIRST * time[1], 1.1 * time[-1]),
        ylim=(max(kinetic[-1], 1e-14), 5 * stored[0]),
    )
    axes.legend(frameon=False, loc="lower left")


def _chosen_snapshots(nodes: np.ndarray) -> list[int]:
    """Snapshots at which the sheet has reached these fractions of its in-plane contraction."""
    area = np.ptp(nodes[..., :2], axis=(1, 2)).prod(axis=1)
    contracted, whole = area[0] - area, area[0] - area[-1]
    reached = [contracted >= (part - 1e-9) * whole for part in CONTRACTED]
    return [*(int(np.argmax(each)) for each in reached), len(nodes) - 1]


FIGURE = FigureKind(relaxation_figure, needs="snapshot_position")
