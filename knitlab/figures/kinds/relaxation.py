"""How a flat sheet relaxes in time: its energies, and snapshots."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.export.meshes.fabric import closed_nodes
from knitlab.figures import sheets
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS, Look

CONTRACTED = (0.0, 0.15, 0.5)  # fractions of the in-plane contraction at the first snapshots


@figure(needs="snapshot_position")
def relaxation(case: xr.Dataset) -> Figure:
    """Kinetic energy against time, and snapshots (paper, Fig. "unit simulation")."""
    nodes = snapshot_nodes(case)
    area = np.ptp(nodes[..., :2], axis=(1, 2)).prod(axis=1)
    contracted = area[0] - area
    reached = [contracted >= (fraction - 1e-9) * contracted[-1] for fraction in CONTRACTED]
    chosen = [*(int(np.argmax(each)) for each in reached), len(nodes) - 1]
    figure = Figure(figsize=(TWO_COLUMNS, 4.2))
    axes = figure.add_axes((0.085, 0.51, 0.9, 0.42))
    time, kinetic = case["time"].values[1:], case["kinetic_energy"].values[1:]
    stored = case["potential_energy"].values
    at_once = stored[0] > stored[-1]  # the folds have all their rest angles at the beginning
    elastic, label = stored[1:], "elastic energy, while the folds develop"
    if at_once:
        elastic, label = elastic - elastic[-1], "elastic energy above the relaxed state"
    axes.plot(time, kinetic, color=CATEGORY_COLOURS[0], label="kinetic energy $T$")
    axes.plot(time, np.where(elastic > 0, elastic, np.nan), "--", color="0.45", label=label)
    axes.set(xlabel="time since the flat sheet was released [ms]", ylabel="energy [N mm]")
    axes.set(xscale="log" if at_once else "linear", yscale="log")
    axes.set_xlim(0.7 * time[0] if at_once else 0, (1.1 if at_once else 1.03) * time[-1])
    axes.set_ylim(max(kinetic[-1], 1e-14), 5 * max(stored))
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    width = 1 / len(chosen)
    beside: Look = {"xytext": (2, -2), "textcoords": "offset points", "va": "top"}
    for column, (snapshot, letter) in enumerate(zip(chosen, "abcd", strict=True)):
        instant = float(case["snapshot"][snapshot])
        at = max(instant, axes.get_xlim()[0])
        axes.axvline(at, color="0.75", lw=0.6, zorder=0)
        axes.annotate(letter, (at, 1), xycoords=("data", "axes fraction"), **beside)
        scene = figure.add_axes((column * width, 0.03, width, 0.34), projection="3d")
        sheets.draw_sheet(scene, nodes[snapshot])
        sheets.frame_sheet(scene, nodes)
        if column == 0:
            sheets.draw_scale(scene, nodes[:1])
        figure.text((column + 0.5) * width, 0.37, f"{letter}: {instant:.2g} ms", ha="center")
    axes.set_title(sheets.design_text(case), loc="left")
    return figure


def snapshot_nodes(case: xr.Dataset) -> np.ndarray:
    """Node positions (snapshot, y, x, component) of a relaxation, periodic fabric closed [mm]."""
    names = ("position", "length_x", "length_y")
    states = {f"snapshot_{name}": name for name in names if f"snapshot_{name}" in case}
    return closed_nodes(case[[*states]].rename(states | {"snapshot": "applied_strain"}))
