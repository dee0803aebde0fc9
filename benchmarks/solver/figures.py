"""The figures, from the cube alone."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.solver.cube import NOT_MEASURED, NOT_REACHED
from benchmarks.solver.methods import SWEPT
from knitlab.figures.figure_files import save
from knitlab.figures.style import ONE_COLUMN, print_style

# Okabe and Ito's colours, told apart by the colour-blind, and a wine red for their yellow, which
# white paper swallows; the marker says it once more.
LOOKS = {
    "knitlab": ("#0072B2", "o", "knitlab"),
    "knitlab_as_swept": ("#CC79A7", "*", "knitlab, from periodic fabric, 2 threads"),
    "knitlab_across_edge": ("#882255", "o", "the same, fold angles across the edge"),
    "knitlab_direct": ("#56B4E9", "s", "knitlab, 3 % steps"),
    "knitlab_cholmod": ("#009E73", "^", "knitlab, CHOLMOD"),
    "lbfgs": ("#E69F00", "D", "L-BFGS"),
    "fire": ("#D55E00", "v", "FIRE"),
    "dynamics": ("#000000", "P", "damped dynamics"),
}
THREADS = dict.fromkeys(SWEPT, 2)
"""Of what does not run on one."""
OPEN = ("knitlab_across_edge",)
"""What is drawn in outline and dashes, as it lies upon another."""
ARROW = 0.35
"""Length of the arrow on a time after which a method was given up, as part of that time."""
HEIGHT, HEIGHT_WITH_LEGEND = 3.1, 4.0
SUFFIXES = (".pdf", ".png")


def draw_all(cube: xr.Dataset, folder: Path) -> Iterator[Path]:
    """Draw each figure that the cube has numbers for, for print and for the screen."""
    for name, draw in FIGURES.items():
        with print_style():
            figure = draw(cube)
            if figure is None:
                continue
            for suffix in SUFFIXES:
                save(figure, folder / f"{name}{suffix}")
                yield folder / f"{name}{suffix}"


def time_against_size(cube: xr.Dataset) -> Figure | None:
    """Median time of relaxation and 15 load steps, its spread, and the fitted slopes.

    An arrow stands on the time after which a method was given up; what failed sooner is named.
    """
    if "tension" not in cube.get("task", ()):
        return None
    of = _one_design(cube).sel(task="tension", boundary="clamped")
    if not of["seconds_median"].notnull().any():
        return None
    figure = Figure(figsize=(ONE_COLUMN, HEIGHT_WITH_LEGEND), layout="constrained")
    axes = figure.subplots()
    for solver in _shown(of):
        colour, marker, label = LOOKS[solver]
        each = of.sel(solver=solver, workers=THREADS.get(solver, 1)).sortby("nodes")
        middle = each["seconds_median"]
        spread = np.array([middle - each["seconds_least"], each["seconds_most"] - middle])
        slope = float(each["slope"])
        fit = f", $s$ = {slope:.2f}" if np.isfinite(slope) else ""
        given_up = each["given_up_after"].max("repeat")
        if given_up.notnull().any():
            fit += "; ↑ given up"
        failed = (each["status"] == NOT_REACHED).any("repeat") & given_up.isnull()
        if failed.any():
            fit += f"; fails at {float(each['nodes'].where(failed).min()):,.0f} nodes"
        outline, line, size = ("none", "--", 6) if solver in OPEN else (colour, "-", 3.5)
        draw = partial(
            axes.errorbar,
            each["nodes"],
            color=colour,
            marker=marker,
            ls="",
            capsize=1.5,
            elinewidth=0.6,
        )
        draw(middle, spread, mfc=outline, ms=size, label=label + fit)
        draw(given_up, ARROW * given_up, lolims=True, mfc="white", ms=3.5)
        _draw_fit(axes, each["nodes"].values, middle.values, slope, colour, line)
    axes.set(xscale="log", yscale="log", xlabel="size [nodes]")
    axes.set_ylabel("relaxation + 15 load steps [s]")
    figure.legend(
        loc="outside upper center",
        frameon=False,
        title="time ~ nodes$^s$",
        handletextpad=0.3,
        fontsize="x-small",
    )
    return figure


def _draw_fit(
    axes: Axes, nodes: np.ndarray, seconds: np.ndarray, slope: float, colour: str, line: str
) -> None:
    known = np.isfinite(nodes) & np.isfinite(seconds)
    if not np.isfinite(slope) or not known.any():
        return
    ends = np.array([nodes[known].min(), nodes[known].max()])
    level = np.exp(np.mean(np.log(seconds[known]) - slope * np.log(nodes[known])))
    axes.plot(ends, level * ends**slope, color=colour, ls=line, lw=0.9)


def time_to_residual(cube: xr.Dataset) -> Figure | None:
    """Residual against the time after which it was first reached, by method.

    It shows the largest sample that the most methods relaxed. A line that does not come down to
    the lowest level was given up: its method did not reach it.
    """
    if "time_to_residual" not in cube:
        return None
    times = _one_design(cube)["time_to_residual"]
    begun = times.notnull().any("level").any("repeat").sum("solver")
    nodes = _one_design(cube)["nodes"].sel(boundary="clamped").reindex(size=begun["size"])
    size = str(nodes.where(begun == begun.max()).fillna(0).idxmax("size").item())
    times = times.sel(size=size)
    figure = Figure(figsize=(ONE_COLUMN, HEIGHT), layout="constrained")
    axes = figure.subplots()
    lowest = float(times["level"].min())
    for solver in LOOKS:
        # One load step or many: relaxation is the same.
        if solver == "knitlab_direct" or solver not in times["solver"]:
            continue
        each = times.sel(solver=solver).sortby("level", ascending=False)
        middle, level = each.median("repeat").values, each["level"].values
        known = np.isfinite(middle)
        if not known.any():
            continue
        colour, marker, label = LOOKS[solver]
        reached = level[known].min() <= lowest
        axes.plot(
            middle[known],
            level[known],
            color=colour,
            marker=marker,
            markevery=[-1],
            ms=4,
            drawstyle="steps-post",
            label=label if reached else f"{label} (given up)",
        )
        axes.fill_betweenx(
            level[known],
            each.min("repeat").values[known],
            each.max("repeat").values[known],
            color=colour,
            alpha=0.2,
            lw=0,
        )
    count = int(nodes.sel(size=size))
    axes.set(xscale="log", yscale="log", xlabel="time on one thread [s], band: range of repeats")
    axes.set_ylabel("largest force on a free unknown [N]")
    axes.set_title(f"relaxation, {size.replace('x', ' × ')} unit cells, {count:,} nodes")
    axes.legend(frameon=False, handletextpad=0.4)
    return figure


FIGURES: dict[str, Callable[[xr.Dataset], Figure | None]] = {
    "time_against_size": time_against_size,
    "time_to_residual": time_to_residual,
}


def _one_design(cube: xr.Dataset) -> xr.Dataset:
    """The design that the methods are compared on."""
    return cube.sel(n_stripe=4, n_subunit=16)


def _shown(of: xr.Dataset) -> list[str]:
    known = (of["status"] != NOT_MEASURED).any(["size", "workers", "repeat"])
    return [name for name in LOOKS if name in of["solver"] and bool(known.sel(solver=name))]
