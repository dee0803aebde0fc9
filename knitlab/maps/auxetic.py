"""The auxetic design map: lowest Poisson's ratio over (n_stripe, n_subunit)."""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.maps.style import STRAIN_COLOURS, TWO_COLUMNS
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


def auxetic_map(cube: xr.Dataset) -> Figure:
    """Lowest ν of every design as colour and number, with the applied strain it occurs at.

    Designs without a value are hatched by status, so that a failure never looks like a value.
    """
    lowest = cube["poisson_ratio_min"].transpose("n_stripe", "n_subunit")
    at = cube["applied_strain_at_min"].transpose("n_stripe", "n_subunit")
    status = cube["status"].transpose("n_stripe", "n_subunit")
    rows, columns = lowest.shape
    # The same colour means the same value in every map, unless one goes beyond ±1.
    largest = float(np.nanmax(np.abs([*lowest.values.ravel(), 1.0])))
    norm = mpl.colors.Normalize(-largest, largest)
    colours = mpl.colormaps[STRAIN_COLOURS]

    marked: set[Status] = set()
    figure = Figure(figsize=(TWO_COLUMNS, max(2.4, 1.1 + 0.5 * rows)), layout="constrained")
    axes = figure.add_subplot()
    for row in range(rows):
        for column in range(columns):
            code = Status(int(status[row, column]))
            value = float(lowest[row, column])
            if code is Status.ok and np.isfinite(value):
                colour = colours(norm(value))
                _cell(axes, row, column, facecolor=colour, edgecolor="white")
                ink = "white" if _luminance(colour) < 0.45 else "black"
                axes.text(column, row + 0.14, f"{value:.2f}", ha="center", va="center", color=ink)
                strain = f"at {float(at[row, column]):.0%}"
                axes.text(
                    column, row - 0.2, strain, ha="center", va="center", color=ink, fontsize=6
                )
            else:
                _cell(axes, row, column, **MARKS[code])
                marked.add(code)

    axes.set(
        xlim=(-0.5, columns - 0.5),
        ylim=(-0.5, rows - 0.5),
        xticks=range(columns),
        yticks=range(rows),
        xticklabels=cube["n_subunit"].values,
        yticklabels=cube["n_stripe"].values,
        xlabel="n_subunit: stitches along a garter stripe",
        ylabel="n_stripe: stitches\nacross a rib stripe",
    )
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    figure.colorbar(
        mpl.cm.ScalarMappable(norm, colours),
        ax=axes,
        pad=0.01,
        label="lowest Poisson's ratio\n(negative: auxetic)",
    )
    handles = [Patch(label=NAMES[code], **MARKS[code]) for code in sorted(marked)]
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=4, frameon=False)
    return figure


def _cell(axes: Axes, row: int, column: int, **style: Any) -> None:
    axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, linewidth=1.5, **style))


def _luminance(colour: tuple[float, ...]) -> float:
    return 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
