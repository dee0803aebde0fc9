"""The sensor design map: how steep and over what range every design senses, and the trade-off."""

from textwrap import fill

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.maps.cells import MARKS, cell, frame, ink_on, marks_legend
from knitlab.maps.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.maps.trade_off import Design, figures_of, trade_off_front
from knitlab.sweep.faults import fault
from knitlab.sweep.registry import Status

STEEPNESS, RANGE = "sensitivity", "working_range"
MARKERS = "osD^vP*X"
LETTERS_A_LINE = 110
MAP_ROW, MAP_MARGIN, TRADE_OFF = 0.32, 0.5, 3.1
"""Heights of a row of a map, of what is around it, and of the trade-off [in]."""
NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


def sensor_map(cube: xr.Dataset) -> Figure:
    """Sensitivity and working range of every design, and one against the other.

    Designs that no other beats in both are joined and listed. Designs without a value are marked
    by status, so that a failure never looks like one.

    Raises:
        BadInput: if the cube is of fabrics without electrodes.
    """
    if STEEPNESS not in cube:
        raise fault("sensor", NEEDED)
    rows = cube.sizes["n_stripe"]
    height = MAP_MARGIN + MAP_ROW * rows
    figure = Figure(figsize=(TWO_COLUMNS, 2 * height + TRADE_OFF), layout="constrained")
    first, second, below = figure.subplots(3, 1, height_ratios=(height, height, TRADE_OFF))
    marked = _map(figure, first, cube, STEEPNESS, "sensitivity\n|dC/dε| [pF]", "{:.2f}")
    marked |= _map(figure, second, cube, RANGE, "working range\nof applied strain", "{:.0%}")
    second.set_xlabel("n_subunit: stitches along a garter stripe")
    marks_legend(figure, marked, NO_VALUE)
    _trade_off(below, cube)
    return figure


def _map(
    figure: Figure, axes: Axes, cube: xr.Dataset, name: str, label: str, number: str
) -> set[Status]:
    values = cube[name].transpose("n_stripe", "n_subunit").values
    status = cube["status"].transpose("n_stripe", "n_subunit").values
    finite = values[np.isfinite(values)]
    norm = mpl.colors.Normalize(0, float(finite.max()) if finite.size else 1.0)
    colours = mpl.colormaps[SEQUENCE_COLOURS]
    marked: set[Status] = set()
    for row, column in np.ndindex(values.shape):
        code, value = Status(int(status[row, column])), float(values[row, column])
        if code is Status.ok and np.isfinite(value):
            colour = colours(norm(value))
            cell(axes, row, column, facecolor=colour, edgecolor="white")
            text = number.format(value)
            axes.text(column, row, text, ha="center", va="center", color=ink_on(colour))
        else:
            cell(axes, row, column, **MARKS[code])
            marked.add(code)
    rows, columns = values.shape
    axes.set(
        xlim=(-0.5, columns - 0.5),
        ylim=(-0.5, rows - 0.5),
        yticks=range(rows),
        yticklabels=cube["n_stripe"].values,
        xticks=range(columns),
        xticklabels=cube["n_subunit"].values,
        ylabel="n_stripe: stitches\nacross a rib stripe",
    )
    bar = mpl.cm.ScalarMappable(norm, colours)
    frame(figure, axes, bar, label=label)
    return marked


def _trade_off(axes: Axes, cube: xr.Dataset) -> None:
    figures = figures_of(cube, STEEPNESS, RANGE)
    stripes = sorted({n_stripe for n_stripe, _ in figures})
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.85, max(len(stripes), 1)))
    for n_stripe, shade, marker in zip(stripes, shades, MARKERS, strict=False):
        points = np.array([its for (n, _), its in figures.items() if n == n_stripe])
        axes.plot(
            points[:, 1], points[:, 0], marker, color=shade, ms=5, label=f"n_stripe = {n_stripe}"
        )
    front = trade_off_front(figures)
    ends = np.array([figures[design] for design in front]).reshape(-1, 2)
    axes.step(ends[:, 1], ends[:, 0], where="post", color="0.5", lw=0.8, zorder=0)
    for design in figures:
        on_front = design in front
        axes.annotate(
            f"{design}" if on_front else f"{design[1]}",
            (figures[design][1], figures[design][0]),
            xytext=(4, 3),
            textcoords="offset points",
            fontsize=6.5 if on_front else 4.5,
            color="black" if on_front else "0.5",
        )
    axes.set(xlabel="working range of applied strain [1]", ylabel="sensitivity |dC/dε| [pF]")
    axes.margins(0.12)
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_title(_listed(front, figures), loc="left", fontsize=7, pad=20)
    if figures:
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(stripes), frameon=False)


def _listed(front: list[Design], figures: dict[Design, tuple[float, ...]]) -> str:
    """The front in words, the steepest first."""
    each = [f"{design} {figures[design][0]:.2f} pF, {figures[design][1]:.0%}" for design in front]
    return fill(f"Front, the steepest for its range: {'; '.join(each)}", LETTERS_A_LINE)
