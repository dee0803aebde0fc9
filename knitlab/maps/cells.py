"""Cells of a design map: coloured by a value, or marked by status where there is none."""

from collections.abc import Collection
from typing import Any

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.sweep.registry import Status

MARKS: dict[Status, dict[str, Any]] = {
    Status.ok: {"facecolor": "white", "edgecolor": "0.6"},
    Status.excluded: {"facecolor": "0.93", "edgecolor": "white"},
    Status.pending: {"facecolor": "white", "edgecolor": "0.6", "hatch": "...."},
    Status.not_converged: {"facecolor": "white", "edgecolor": "black", "hatch": "////"},
    Status.failed: {"facecolor": "white", "edgecolor": "black", "hatch": "xxxx"},
}
NAMES = {
    Status.excluded: "no such design, or not in this sweep",
    Status.ok: "no ratio: not stretched, or a single clamped cell",
    Status.pending: "not yet run",
    Status.not_converged: "not converged",
    Status.failed: "failed",
}


def cell(axes: Axes, row: int, column: float, **style: Any) -> None:
    """Draw one cell, a unit wide and high."""
    axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, **{"linewidth": 1.5, **style}))


def frame(figure: Figure, axes: Axes, scale: ScalarMappable, **colorbar: Any) -> None:
    """Take the frame and the ticks off a map of cells, and put the scale of its colours beside it.

    Args:
        figure: the map's.
        axes: its axes.
        scale: norm and colours.
        colorbar: what else the scale's bar is to have, its label first of all.
    """
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    figure.colorbar(scale, ax=axes, pad=0.01, **colorbar)


def ink_on(colour: tuple[float, ...]) -> str:
    """What can be read on a colour: black or white."""
    luminance = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return "white" if luminance < 0.45 else "black"


def marks_legend(figure: Figure, marked: Collection[Status], no_value: str | None = None) -> None:
    """Say below a figure what the marks in it mean.

    Args:
        figure: the figure.
        marked: the statuses that are marked.
        no_value: why a design that is ok may have no value, if not as in the auxetic map.
    """
    names = NAMES if no_value is None else NAMES | {Status.ok: no_value}
    handles = [Patch(label=names[code], **MARKS[code]) for code in sorted(marked)]
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=4, frameon=False)
