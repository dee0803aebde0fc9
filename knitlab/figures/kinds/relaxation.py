"""The relaxation by dynamics: kinetic energy and snapshots."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.kinds import FigureKind
from knitlab.figures.sheets import design_text, draw_sheet, frame_sheet
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS, Look
from knitlab.meshes.fabric import closed_nodes

CONTRACTED = (0.0, 0.15, 0.5)  # fractions of the in-plane contraction at the first snapshots


def relaxation_figure(case: xr.Dataset) -> Figure:
    """Kinetic energy against time, and snapshots (paper, Fig. "unit simulation")."""
    nodes = snapshot_nodes(case)
    chosen = _chosen_snapshots(nodes)
    figure = Figure(figsize=(TWO_COLUMNS, 4.2))
    axes = figure.add_axes((0.085, 0.52, 0.9, 0.42))
    _draw_energies(axes, case)
    width = 1 / len(chosen)
    beside: Look = {"xytext": (2, -2), "textcoords": "offset points", "va": "top"}
    for column, (snapshot, letter) in enumerate(zip(chosen, "abcd", strict=True)):
        time = float(case["snapshot"][snapshot])
        at = max(time, axes.get_xlim()[0])
        axes.axvline(at, color="0.75", lw=0.6, zorder=0)
        axes.annotate(letter, (at, 1), xycoords=("data", "axes fraction"), **beside)
        scene = figure.add_axes((column * width, 0.0, width, 0.36), projection="3d")
        draw_sheet(scene, nodes[snapshot])
        frame_sheet(scene, nodes)
        figure.text((column + 0.5) * width, 0.37, f"{letter}: {time:.2g} ms", ha="center")
    figure.text(0.5, 0.97, design_text(case), ha="center")
    return figure


def snapshot_nodes(case: xr.Dataset) -> np.ndarray:
    """Node positions (snapshot, y, x, component) of a relaxation, periodic fabric closed [mm]."""
    states = {f"snapshot_{name}": name for name in ("position", "length_x", "length_y")}
    states = {name: state for name, state in states.items() if name in case}
    return closed_nodes(case[[*states]].rename(states | {"snapshot": "applied_strain"}))


def _draw_energies(axes: Axes, case: xr.Dataset) -> None:
    time, kinetic = case["time"].values, case["kinetic_energy"].values
    stored = case["potential_energy"].values
    excess = (stored - stored[-1])[1:-1]
    axes.loglog(time[1:], kinetic[1:], color=CATEGORY_COLOURS[0], label="kinetic energy $T$")
    label = "elastic energy above the relaxed state"
    axes.loglog(time[1:-1], excess, "--", color="0.45", label=label)
    axes.set(
        xlabel="time since the flat sheet was released [ms]",
        ylabel="energy [N mm]",
        xlim=(0.7 * time[1], 1.1 * time[-1]),
        ylim=(max(kinetic[-1], 1e-14), 5 * stored[0]),
    )
    axes.legend(loc="lower left")


def _chosen_snapshots(nodes: np.ndarray) -> list[int]:
    """Snapshots at which the sheet has reached these fractions of its in-plane contraction."""
    area = np.ptp(nodes[..., :2], axis=(1, 2)).prod(axis=1)
    contracted = area[0] - area
    reached = [contracted >= (fraction - 1e-9) * contracted[-1] for fraction in CONTRACTED]
    return [*(int(np.argmax(each)) for each in reached), len(nodes) - 1]


FIGURES = {"relaxation": FigureKind(relaxation_figure, needs="snapshot_position")}
