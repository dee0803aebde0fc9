"""Designs nearest to targets: what was wanted, what they have, and how targets conflict."""

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cubes.find import Found, Reached
from knitlab.cubes.target import Target
from knitlab.figures.style import (
    CATEGORY_COLOURS,
    ONE_COLUMN,
    STRAIN_LABEL,
    TWO_COLUMNS,
    Look,
    subplots,
)
from knitlab.observables.schema import VARIABLES

MAX_SHOWN = 6  # designs that are drawn, the nearest first
WANTED = CATEGORY_COLOURS[2]
OWN, OTHERS, FRONT = CATEGORY_COLOURS[0], "0.7", "0.3"
RANGE = "range over slightly different fabrics"
NAMED_BY = ("n_stripe", "n_subunit", "pattern")
COLOURS = tuple(colour for colour in CATEGORY_COLOURS if colour != WANTED)  # of the designs


def nearest_figure(nearest: Found, title: str = "designs", bands: bool = False) -> Figure:
    """A row of panels for each target: what is wanted, and the nearest designs and their bands."""
    names = []
    for _, design in nearest.table.head(MAX_SHOWN).iterrows():
        labels = f"({', '.join(str(design[name]) for name in NAMED_BY if name in design)})"
        if "candidate" in design:
            names.append(f"candidate {design['candidate']}: {labels}")
        else:
            names.append(labels + (f"\n{design['cube']}" if "cube" in design else ""))
    rows = len(nearest.reached)
    figure = Figure(figsize=(TWO_COLUMNS, 2.4 * rows + 0.6), layout="constrained")
    panels_of_targets = figure.subfigures(rows, 1, squeeze=False)[:, 0]
    for row, reached in zip(panels_of_targets, nearest.reached, strict=True):
        banded = bands and len(reached.band) == 2
        curved = reached.target.reduction is None and len(reached.at) > 1
        count = len(names) if curved and banded else 1
        panels = row.subplots(1, count, squeeze=False, sharex=True, sharey=True)[0]
        for number, panel in enumerate(panels):
            if not curved:
                _draw_marks(panel, reached, names, banded)
            elif banded:
                _draw_band(panel, reached, number, count)
                panel.set_title(names[number])
            else:
                for values, colour, name in zip(reached.values, COLOURS, names, strict=False):
                    panel.plot(reached.at, values, color=colour, label=name)
            if curved:
                panel.set(xlabel=STRAIN_LABEL, xlim=(reached.at[0], reached.at[-1]))
        # Not before all curves are drawn, which the limits of the panels must hold.
        for panel in panels:
            _draw_wanted(panel, reached.target)
        target, variable = reached.target, VARIABLES.get(reached.target.name)
        name = variable.long_name if variable and target.reduction is None else target.label
        unit = "1" if variable is None or target.reduction == "linearity" else variable.units
        panels[0].set_ylabel(f"{name}\n[{unit}]", fontsize="small")
        # The first panel has every entry: those of the others repeat it.
        row.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(f"the {len(names)} nearest {title}, the nearest first", fontsize="small")
    return figure


def _draw_band(panel: Axes, reached: Reached, number: int, shown: int) -> None:
    others = np.delete(reached.values[:shown], number, axis=0)
    for line in panel.plot(reached.at, others.T, color=OTHERS, lw=0.8)[:1]:
        line.set_label("the other designs")
    low, high = (edge[number] for edge in reached.band)
    panel.fill_between(reached.at, low, high, color=OWN, alpha=0.25, lw=0, label=RANGE)
    panel.plot(reached.at, reached.values[number], color=OWN, label="this design")


def _draw_marks(panel: Axes, reached: Reached, names: list[str], banded: bool) -> None:
    shown = len(names)
    middle = reached.obtained[:shown]
    # Marks, as bars from 0 would hide how near to each other designs are.
    panel.scatter(range(shown), middle, color=COLOURS[:shown], s=30, zorder=5)
    panel.margins(y=0.15)
    panel.set_xlim(-0.5, shown - 0.5)
    panel.set_xticks(range(shown), names)
    if banded and reached.target.reduction is None:
        edges = [np.abs(edge[:shown, 0] - middle) for edge in reached.band]
        look: Look = {"color": "black", "capsize": 3, "zorder": 4}
        panel.errorbar(range(shown), middle, edges, fmt="none", label=RANGE, **look)


def _draw_wanted(panel: Axes, target: Target) -> None:
    shade: Look = {"color": WANTED, "alpha": 0.15, "lw": 0}
    if target.curve is None and target.low != target.high:
        ends = [end for end in (target.low, target.high) if np.isfinite(end)]
        limits = [*panel.get_ylim(), *ends]
        below, above = panel.set_ylim(min(limits), max(limits))
        panel.axhspan(max(target.low, below), min(target.high, above), label="wanted", **shade)
        return
    strains, wanted = target.curve or (panel.get_xlim(), (target.low, target.low))
    panel.plot(strains, wanted, color=WANTED, lw=2, label="wanted", zorder=3)
    if (tolerance := target.tolerance) is not None:
        low, high = (np.add(wanted, sign * tolerance) for sign in (-1, 1))
        panel.fill_between(strains, low, high, label="its tolerance", **shade)


def pareto_figure(
    distances: Float[np.ndarray, "trial 2"], labels: tuple[str, str], candidates: pd.Series
) -> Figure:
    """Trials by their distances from two targets, for each candidate, and the Pareto front."""
    figure, axes = subplots(3.0, width=ONE_COLUMN * 1.4)
    front = distances[non_dominated(distances)]
    front = front[np.argsort(front[:, 0])]
    # Trials far from the front would hide its shape, and are left out.
    room = 0.3 * np.maximum(np.ptp(front, axis=0), 1.0)
    high = front.max(axis=0) + room
    # A point at 0 is not cut by the axis.
    low = np.maximum(front.min(axis=0) - room, -0.04 * high)
    near = ((distances >= low) & (distances <= high)).all(axis=1)
    for number, colour in zip(sorted(candidates.unique()), COLOURS * len(distances), strict=False):
        shown = distances[(candidates == number).to_numpy() & near]
        look: Look = {"ms": 4, "alpha": 0.7, "color": colour, "clip_on": False}
        axes.plot(*shown.T, "o", label=f"search {number}", **look)
    axes.plot(*front.T, "-", color=FRONT, lw=1, label="Pareto front", zorder=0)
    axes.axvspan(0, 1, color=WANTED, alpha=0.1, lw=0, label="within a tolerance")
    axes.axhspan(0, 1, color=WANTED, alpha=0.1, lw=0)
    for k, (axis, label) in enumerate(zip("xy", labels, strict=True)):
        axes.set(**{f"{axis}lim": (low[k], high[k])})
        getattr(axes, f"set_{axis}label")(f"off by, in tolerances:\n{label}", fontsize="small")
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def non_dominated(losses: Float[np.ndarray, "point loss"]) -> Bool[np.ndarray, " point"]:
    """Whether no other point dominates a point: no larger in any loss, and smaller in one."""
    point, other = losses[:, None], losses[None]
    dominated = np.all(other <= point, axis=2) & np.any(other < point, axis=2)
    return np.logical_not(dominated.any(axis=1))
