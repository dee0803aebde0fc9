"""The sensor design map: sensitivity and working range of every design, and their trade-off."""

from collections.abc import Sequence
from textwrap import fill

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.cells import (
    CellStyle,
    draw_cells,
    frame,
    marks_legend,
    measured_note,
    row_count,
    values_of,
)
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.figures.trade_off import Design, pareto_front, values_of_designs
from knitlab.io.cube_file import is_measured
from knitlab.io.design_status import Status
from knitlab.io.errors import fault

SENSITIVITY, RANGE = "sensitivity", "working_range"
MARKERS = "osD^vP*X"
LETTERS_A_LINE = 110
MAP_ROW, MAP_MARGIN, TRADE_OFF = 0.32, 0.5, 3.1
"""Heights of a row of a map, of the space around it, and of the trade-off [in]."""
FEWEST_ROWS = 3
"""Smallest number of rows that a map has room for; its labels need it."""
NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


def sensor_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    The Pareto front is joined and listed. Designs without a value are marked by status, so that a
    failure never looks like a value; measured ones have a dashed frame.

    Raises:
        BadInput: if a cube is of fabrics without electrodes.
    """
    if any(SENSITIVITY not in cube for cube in cubes):
        raise fault("sensor", NEEDED)
    rows = row_count(cubes)
    height = MAP_MARGIN + MAP_ROW * max(rows, FEWEST_ROWS)
    figure = Figure(figsize=(TWO_COLUMNS, 2 * height + TRADE_OFF), layout="constrained")
    first, second, below = figure.subplots(3, 1, height_ratios=(height, height, TRADE_OFF))
    marked = _map(figure, first, cubes, SENSITIVITY, "sensitivity\n|dC/dε| [pF]", "{:.2f}")
    marked |= _map(figure, second, cubes, RANGE, "working range\nof applied strain", "{:.0%}")
    second.set_xlabel("n_subunit: stitches along a garter stripe")
    marks_legend(figure, marked, NO_VALUE, measured_note(cubes))
    _trade_off(below, cubes)
    return figure


def _map(
    figure: Figure,
    axes: Axes,
    cubes: Sequence[xr.Dataset],
    name: str,
    label: str,
    number: str,
) -> set[Status]:
    norm = mpl.colors.Normalize(0, float(max(values_of(cubes, name), default=1.0)))
    colours = mpl.colormaps[SEQUENCE_COLOURS]
    style = CellStyle(
        name, lambda value: colours(norm(value)), lambda value, design: number.format(value)
    )
    marked = draw_cells(axes, cubes, style)
    frame(figure, axes, mpl.cm.ScalarMappable(norm, colours), label=label)
    return marked


def _trade_off(axes: Axes, cubes: Sequence[xr.Dataset]) -> None:
    simulated, measured = (
        {
            design: values
            for cube in cubes
            if is_measured(cube) is experimental
            for design, values in values_of_designs(cube, SENSITIVITY, RANGE).items()
        }
        for experimental in (False, True)
    )
    plotted = simulated or measured
    stripes = sorted({n_stripe for n_stripe, _ in plotted})
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.85, max(len(stripes), 1)))
    for n_stripe, shade, marker in zip(stripes, shades, MARKERS, strict=False):
        points = np.array([values for (n, _), values in plotted.items() if n == n_stripe])
        axes.plot(
            points[:, 1], points[:, 0], marker, color=shade, ms=5, label=f"n_stripe = {n_stripe}"
        )
    front = pareto_front(plotted)
    ends = np.array([plotted[design] for design in front]).reshape(-1, 2)
    axes.step(ends[:, 1], ends[:, 0], where="post", color="0.5", lw=0.8, zorder=0)
    for design in plotted:
        on_front = design in front
        axes.annotate(
            f"{design}" if on_front else f"{design[1]}",
            (plotted[design][1], plotted[design][0]),
            xytext=(4, 3),
            textcoords="offset points",
            fontsize=6.5 if on_front else 4.5,
            color="black" if on_front else "0.5",
        )
    if simulated:
        for design, (sensitivity, width) in measured.items():
            axes.plot(width, sensitivity, "o", ms=8, mfc="none", mec="black", ls="")
            axes.annotate(
                f"{design} measured",
                (width, sensitivity),
                xytext=(7, -7),
                textcoords="offset points",
                fontsize=6.5,
            )
    axes.set(xlabel="working range of applied strain [1]", ylabel="sensitivity |dC/dε| [pF]")
    axes.margins(0.12)
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_title(_listed(front, plotted), loc="left", fontsize=7, pad=20)
    if plotted:
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=len(stripes), frameon=False)


def _listed(front: list[Design], plotted: dict[Design, tuple[float, ...]]) -> str:
    """The Pareto front as text, in descending order of sensitivity."""
    each = [f"{design} {plotted[design][0]:.2f} pF, {plotted[design][1]:.0%}" for design in front]
    return fill(f"Pareto front: {'; '.join(each)}", LETTERS_A_LINE)


FIGURE = FigureKind(sensor_map, several="designs")
