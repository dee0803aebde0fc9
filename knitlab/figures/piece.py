"""A shaped piece: the wanted outline, and those of the pieces that were simulated."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from knitlab.figures.style import ONE_COLUMN, TWO_COLUMNS, shades, subplots

if TYPE_CHECKING:
    from knitlab.export.pieces.fitting import Fit


def piece_figure(fit: "Fit") -> Figure:
    """The nearest piece on the wanted outline, and the distance of every round [mm]."""
    width, length = fit.wanted.size
    height = min(max(0.55 * TWO_COLUMNS * length / width, ONE_COLUMN * 0.6), 1.3 * TWO_COLUMNS)
    figure, (outlines, distances) = subplots(height, columns=2, width_ratios=(2, 1))
    outlines.fill(*fit.wanted.points.T, color="0.88", lw=0, label="wanted")
    for number, (each, colour) in enumerate(
        zip(fit.rounds, shades(len(fit.rounds)), strict=True), start=1
    ):
        if each.outline is not None:
            closed = np.concatenate([each.outline.points, each.outline.points[:1]])
            best = each is fit.best
            label = f"round {number}" + (", taken" if best else "")
            look = {"lw": 1.2 if best else 0.5, "zorder": 2 + best}
            outlines.plot(*closed.T, color=colour, label=label, **look)
    outlines.set(xlabel="along the courses [mm]", ylabel="along the wales [mm]")
    outlines.set_aspect("equal")
    figure.legend(loc="outside upper center", ncols=4)
    rounds = np.arange(1, len(fit.rounds) + 1)
    distances.plot(rounds, [each.distance for each in fit.rounds], "o-", color="0.2")
    distances.axhline(min(fit.best.cell), color="0.5", ls="--", lw=0.8)
    distances.annotate(
        "unit cell", (rounds[0], min(fit.best.cell)), (2, 2), textcoords="offset points"
    )
    distances.set(xlabel="round", ylabel="distance from the outline [mm]", xticks=rounds)
    distances.set_ylim(bottom=0)
    return figure
