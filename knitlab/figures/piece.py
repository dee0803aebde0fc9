"""A shaped piece: what is wanted, and the pieces that were simulated."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.style import ONE_COLUMN, TWO_COLUMNS, shades, subplots

if TYPE_CHECKING:
    from knitlab.export.pieces.fitting import Fit, Round


def piece_figure(fit: "Fit") -> Figure:
    """All rounds: their outlines, their widening if one is wanted, and how far they are off."""
    width, length = fit.wanted.size
    ratios = (2, 1) if fit.widening is None else (2, 1, 1)
    share = 0.8 * ratios[0] / sum(ratios)
    height = share * TWO_COLUMNS * length / width
    height = min(max(height, ONE_COLUMN * 0.7), 1.3 * TWO_COLUMNS)
    figure, (outlines, *others) = subplots(height, columns=len(ratios), width_ratios=ratios)
    colours = shades(len(fit.rounds))
    outlines.fill(*fit.wanted.points.T, color="0.88", lw=0, label="wanted")
    for number, (each, colour) in enumerate(zip(fit.rounds, colours, strict=True), start=1):
        if each.outline is not None:
            closed = np.concatenate([each.outline.points, each.outline.points[:1]])
            label = f"round {number}" + (", taken" if each is fit.best else "")
            outlines.plot(*closed.T, color=colour, label=label, **_look(fit, each))
    outlines.set(xlabel="along the courses [mm]", ylabel="along the wales [mm]")
    outlines.set_aspect("equal")
    figure.legend(loc="outside upper center", ncols=4)
    if fit.widening is not None:
        _draw_widening(others[0], fit)
    _draw_errors(others[-1], fit)
    return figure


def _look(fit: "Fit", each: "Round") -> dict[str, Any]:
    taken = each is fit.best
    return {"lw": 1.2 if taken else 0.5, "zorder": 2 + taken}


def _draw_widening(axes: Axes, fit: "Fit") -> None:
    assert fit.widening is not None
    _, length = fit.wanted.size
    axes.plot(fit.widening.widening, fit.widening.place * length, color="0.75", lw=4)
    for each, colour in zip(fit.rounds, shades(len(fit.rounds)), strict=True):
        if each.outline is not None:
            axes.plot(each.widening, each.place * length, color=colour, **_look(fit, each))
    stretch = f"strain along the courses\nat {fit.widening.stretch:.0%} along the wales [1]"
    axes.set(xlabel=stretch, ylabel="place in the relaxed piece [mm]")


def _draw_errors(axes: Axes, fit: "Fit") -> None:
    rounds = np.arange(1, len(fit.rounds) + 1)
    axes.plot(
        rounds, [each.error if each.outline else np.nan for each in fit.rounds], "o-", color="0.2"
    )
    axes.axhline(1, color="0.5", ls="--", lw=0.8)
    of = "unit cells" if fit.widening is None else "tolerances"
    axes.set(xlabel="round", ylabel=f"distance from what is wanted [{of}]", xticks=rounds)
    axes.set_ylim(bottom=0)
