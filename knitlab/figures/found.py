"""Found designs: what was wanted, and what the nearest designs have."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.style import TWO_COLUMNS
from knitlab.io.schema import VARIABLES
from knitlab.tables.find import Found, Reached

MOST_SHOWN = 6
"""Designs that are drawn, the nearest first."""
WANTED = "#009E73"
NAMED_BY = ("n_stripe", "n_subunit", "pattern")
COLOURS = ("C0", "C1", "C3", "C4", "C5", "C6")
"""Colours of the designs; none is green."""
PANEL_HEIGHT = 2.4
"""Height of the panel of a target [in]."""


def found_figure(found: Found, title: str = "designs", bands: bool = False) -> Figure:
    """One panel for each target: what is wanted in green, and the nearest designs.

    Args:
        found: designs by their distance from the targets.
        title: what the designs are called.
        bands: whether to shade the range over the siblings of a design.
    """
    shown = min(MOST_SHOWN, len(found.table))
    names = [_name(found, place) for place in range(shown)]
    panels = len(found.reached)
    size = (TWO_COLUMNS, PANEL_HEIGHT * panels + 0.5)
    figure = Figure(figsize=size, layout="constrained")
    for panel, reached in zip(
        figure.subplots(panels, 1, squeeze=False)[:, 0], found.reached, strict=True
    ):
        colours = COLOURS[:shown]
        if reached.target.reduction is None and len(reached.at) > 1:
            for place in range(shown):
                panel.plot(
                    reached.at, reached.values[place], color=colours[place], label=names[place]
                )
                if bands and len(reached.band) == 2:
                    edges = [edge[place] for edge in reached.band]
                    panel.fill_between(reached.at, *edges, color=colours[place], alpha=0.2, lw=0)
            panel.set_xlabel("applied strain [1]")
            panel.set_xlim(reached.at[0], reached.at[-1])
        else:
            panel.bar(range(shown), reached.obtained[:shown], color=colours, width=0.5, zorder=2)
            panel.set_xticks(range(shown), names)
            if bands and len(reached.band) == 2 and reached.target.reduction is None:
                middle = reached.obtained[:shown]
                edges = [np.abs(edge[:shown, 0] - middle) for edge in reached.band]
                panel.errorbar(
                    range(shown), middle, edges, fmt="none", color="black", capsize=3, zorder=4
                )
        _draw_wanted(panel, reached)
        variable = VARIABLES.get(reached.target.name)
        unit = variable.units if variable else "1"
        panel.set_ylabel(f"{reached.target.label}\n[{unit}]", fontsize="small")
        if panel.get_legend_handles_labels()[1]:
            panel.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.suptitle(f"the {shown} nearest {title}; wanted in green", fontsize="small")
    return figure


def _name(found: Found, place: int) -> str:
    row = found.table.iloc[place]
    labels = ", ".join(str(row[name]) for name in NAMED_BY if name in row)
    if "candidate" in row:
        return f"{row['candidate']}: ({labels})"
    cube = f"\n{row['cube']}" if "cube" in row else ""
    return f"({labels}){cube}"


def _draw_wanted(panel: Axes, reached: Reached) -> None:
    """Shade the wanted range; a single value is a line."""
    target = reached.target
    if target.curve is not None:
        strains, wanted = map(np.asarray, target.curve)
        panel.plot(strains, wanted, color=WANTED, lw=2, label="wanted", zorder=3)
        if target.tolerance is not None:
            edges = wanted - target.tolerance, wanted + target.tolerance
            panel.fill_between(strains, *edges, color=WANTED, alpha=0.15, lw=0)
        return
    if target.low == target.high:
        panel.axhline(target.low, color=WANTED, lw=2, label="wanted", zorder=3)
        if target.tolerance is not None:
            low, high = target.low - target.tolerance, target.high + target.tolerance
            panel.axhspan(low, high, color=WANTED, alpha=0.15, lw=0)
        return
    below, above = panel.get_ylim()
    below = min([below, *(bound for bound in (target.low,) if np.isfinite(bound))])
    above = max([above, *(bound for bound in (target.high,) if np.isfinite(bound))])
    panel.set_ylim(below, above)
    panel.axhspan(
        max(target.low, below),
        min(target.high, above),
        color=WANTED,
        alpha=0.15,
        lw=0,
        label="wanted",
    )
