"""Found designs: what was wanted, and what the nearest designs have."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cube.find import Found, Reached
from knitlab.cube.schema import VARIABLES
from knitlab.cube.target import Target
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS

MOST_SHOWN = 6
"""Designs that are drawn, the nearest first."""
WANTED = CATEGORY_COLOURS[2]
OWN, OTHERS = CATEGORY_COLOURS[0], "0.7"
TOLERANCE = "its tolerance"
NAMED_BY = ("n_stripe", "n_subunit", "pattern")
COLOURS = tuple(colour for colour in CATEGORY_COLOURS if colour != WANTED)
"""Colours of the designs; none is green."""
PANEL_HEIGHT = 2.4
"""Height of the panels of a target [in]."""


def found_figure(found: Found, title: str = "designs", bands: bool = False) -> Figure:
    """A row of panels for each target: what is wanted in green, and the nearest designs.

    Curves with bands have a panel for each design, with the curves of the others in grey behind
    it: bands of similar designs would cover each other.

    Args:
        found: designs by their distance from the targets.
        title: what the designs are called.
        bands: whether to shade the range over the siblings of a design.
    """
    shown = min(MOST_SHOWN, len(found.table))
    names = [_name(found, place) for place in range(shown)]
    rows = len(found.reached)
    figure = Figure(figsize=(TWO_COLUMNS, PANEL_HEIGHT * rows + 0.6), layout="constrained")
    parts = figure.subfigures(rows, 1, squeeze=False)[:, 0]
    for row, reached in zip(parts, found.reached, strict=True):
        if reached.target.reduction is None and len(reached.at) > 1:
            if bands and len(reached.band) == 2:
                panels = row.subplots(1, shown, squeeze=False, sharex=True, sharey=True)[0]
                for place, panel in enumerate(panels):
                    _draw_band(panel, reached, place, shown)
                    panel.set_title(names[place])
            else:
                panels = [row.subplots()]
                _draw_curves(panels[0], reached, names)
            for panel in panels:
                panel.set_xlabel("applied strain [1]")
                panel.set_xlim(reached.at[0], reached.at[-1])
        else:
            panels = [row.subplots()]
            _draw_bars(panels[0], reached, names, bands)
        for panel in panels:
            _draw_wanted(panel, reached)
        panels[0].set_ylabel(_label(reached.target), fontsize="small")
        handles = {
            label: handle
            for panel in panels
            for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
        }
        row.legend(
            handles.values(), handles.keys(), loc="outside lower center", ncols=4, frameon=False
        )
    figure.suptitle(f"the {shown} nearest {title}, the nearest first", fontsize="small")
    return figure


def _draw_curves(panel: Axes, reached: Reached, names: list[str]) -> None:
    for place, name in enumerate(names):
        panel.plot(reached.at, reached.values[place], color=COLOURS[place], label=name)


def _draw_band(panel: Axes, reached: Reached, place: int, shown: int) -> None:
    """Draw the curve of a design and its band, and the curves of the others behind it."""
    for other in range(shown):
        if other != place:
            label = "the other designs" if other == int(place == 0) else None
            panel.plot(reached.at, reached.values[other], color=OTHERS, lw=0.8, label=label)
    edges = [edge[place] for edge in reached.band]
    label = "range over slightly different fabrics"
    panel.fill_between(reached.at, *edges, color=OWN, alpha=0.25, lw=0, label=label)
    panel.plot(reached.at, reached.values[place], color=OWN, label="this design")


def _draw_bars(panel: Axes, reached: Reached, names: list[str], bands: bool) -> None:
    shown = len(names)
    panel.bar(range(shown), reached.obtained[:shown], color=COLOURS[:shown], width=0.5, zorder=2)
    panel.set_xticks(range(shown), names)
    if bands and len(reached.band) == 2 and reached.target.reduction is None:
        middle = reached.obtained[:shown]
        edges = [np.abs(edge[:shown, 0] - middle) for edge in reached.band]
        panel.errorbar(
            range(shown),
            middle,
            edges,
            fmt="none",
            color="black",
            capsize=3,
            zorder=4,
            label="range over slightly different fabrics",
        )


def _label(target: Target) -> str:
    """Label of the axis of a target."""
    variable = VARIABLES.get(target.name)
    if variable is None:
        return f"{target.label}\n[1]"
    name = variable.long_name if target.reduction is None else target.label
    return f"{name}\n[{variable.units}]"


def _name(found: Found, place: int) -> str:
    row = found.table.iloc[place]
    labels = ", ".join(str(row[name]) for name in NAMED_BY if name in row)
    if "candidate" in row:
        return f"candidate {row['candidate']}: ({labels})"
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
            panel.fill_between(strains, *edges, color=WANTED, alpha=0.15, lw=0, label=TOLERANCE)
        return
    if target.low == target.high:
        panel.axhline(target.low, color=WANTED, lw=2, label="wanted", zorder=3)
        if target.tolerance is not None:
            low, high = target.low - target.tolerance, target.high + target.tolerance
            panel.axhspan(low, high, color=WANTED, alpha=0.15, lw=0, label=TOLERANCE)
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
