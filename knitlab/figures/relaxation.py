"""The relaxation: kinetic energy against time, snapshots, and the fabric folding as a film."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.perspective import by_height, draw_sheet, frame_sheet, snapshot_nodes
from knitlab.figures.style import ONE_COLUMN, SEQUENCE_COLOURS, TWO_COLUMNS

CONTRACTED = (0.0, 0.15, 0.5)
"""Parts of the contraction in the plane at which snapshots are shown, before the last."""
LETTERS = "abcdefgh"
FRAMES_PER_SECOND = 15
LAST_FRAME_HELD = 20
"""Frames for which an animation rests on the relaxed shape."""
FIRST_TIME = 1e-3
"""Where the axis of times begins [ms]."""


def relaxation_figure(case: xr.Dataset) -> Figure:
    """The paper's figure of the relaxation of a fabric by dynamics (Fig. "unit simulation").

    Args:
        case: a case file with the history of its relaxation.
    """
    nodes = snapshot_nodes(case)
    chosen = _chosen_snapshots(nodes)
    times = case["snapshot"].values[chosen]
    figure = Figure(figsize=(TWO_COLUMNS, 4.2))
    axes = figure.add_axes((0.085, 0.52, 0.9, 0.42))
    _draw_energies(axes, case)
    for letter, time in zip(LETTERS, times, strict=False):
        at = max(time, FIRST_TIME)
        axes.axvline(at, color="0.75", lw=0.6, zorder=0)
        axes.annotate(
            letter,
            (at, 1),
            (2, -2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            va="top",
        )
    width, norm = 0.9 / len(chosen), by_height(nodes)
    for column, (place, letter) in enumerate(zip(chosen, LETTERS, strict=False)):
        scene = figure.add_axes((column * width, 0.0, width, 0.36), projection="3d")
        draw_sheet(scene, nodes[place], norm)
        frame_sheet(scene, nodes)
        middle = (column + 0.5) * width
        figure.text(middle, 0.37, f"({letter}) {_time_text(times[column])}", ha="center")
    figure.text(0.5, 0.97, _design_text(case), ha="center")
    bar = figure.add_axes((0.92, 0.06, 0.012, 0.28))
    figure.colorbar(mpl.cm.ScalarMappable(norm, SEQUENCE_COLOURS), cax=bar)
    bar.set_title("z [mm]")
    return figure


def _draw_energies(axes: Axes, case: xr.Dataset) -> None:
    time, kinetic = case["time"].values, case["kinetic_energy"].values
    stored = case["potential_energy"].values
    to_go = stored - stored[-1]
    axes.loglog(time[1:], kinetic[1:], color="C0", label="kinetic energy $T$")
    axes.loglog(time[1:-1], to_go[1:-1], "--", color="0.45", label="elastic energy yet to go")
    axes.set(
        xlabel="time since the flat sheet was let go [ms]",
        ylabel="energy [N mm]",
        xlim=(FIRST_TIME, 1.1 * time[-1]),
        ylim=(max(kinetic[-1], 1e-14), 5 * stored[0]),
    )
    axes.legend(frameon=False, loc="lower left")


def folding_animation(case: xr.Dataset) -> FuncAnimation:
    """The fabric folding, frames evenly spread over the logarithm of time.

    Args:
        case: a case file with the history of its relaxation.
    """
    nodes = snapshot_nodes(case)
    figure = Figure(figsize=(ONE_COLUMN * 1.3, ONE_COLUMN), dpi=120)
    scene = figure.add_axes((0, 0, 1, 0.92), projection="3d")
    last, norm = len(nodes) - 1, by_height(nodes)

    def frame(number: int) -> list[Artist]:
        place = min(number, last)
        scene.clear()
        draw_sheet(scene, nodes[place], norm)
        frame_sheet(scene, nodes)
        when = _time_text(float(case["snapshot"][place]))
        figure.suptitle(f"{_design_text(case)}, {when}", fontsize=8)
        return []

    frames = len(nodes) + LAST_FRAME_HELD
    return FuncAnimation(figure, frame, frames, interval=1000 / FRAMES_PER_SECOND)


def _chosen_snapshots(nodes: np.ndarray) -> list[int]:
    """Snapshots at which the sheet has covered these parts of its contraction in the plane."""
    area = np.ptp(nodes[..., :2], axis=(1, 2)).prod(axis=1)
    contracted = (area[0] - area) / (area[0] - area[-1])
    return [int(np.argmax(contracted >= part - 1e-9)) for part in CONTRACTED] + [len(nodes) - 1]


def _time_text(time: float) -> str:
    return f"{time:.2g} ms"


def _design_text(case: xr.Dataset) -> str:
    return f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"
