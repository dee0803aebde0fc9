"""The auxetic design map: lowest Poisson's ratio over (n_stripe, n_subunit)."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.maps.cells import MARKS, cell, frame, ink_on, marks_legend
from knitlab.maps.style import STRAIN_COLOURS, TWO_COLUMNS
from knitlab.sweep.registry import Status


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
                cell(axes, row, column, facecolor=colour, edgecolor="white")
                ink = ink_on(colour)
                axes.text(column, row + 0.14, f"{value:.2f}", ha="center", va="center", color=ink)
                strain = f"at {float(at[row, column]):.0%}"
                axes.text(
                    column, row - 0.2, strain, ha="center", va="center", color=ink, fontsize=6
                )
            else:
                cell(axes, row, column, **MARKS[code])
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
    label = "lowest Poisson's ratio\n(negative: auxetic)"
    frame(figure, axes, mpl.cm.ScalarMappable(norm, colours), label=label)
    marks_legend(figure, marked)
    return figure
