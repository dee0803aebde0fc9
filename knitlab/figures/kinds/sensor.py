"""The sensor design map: sensitivity and working range of every design, and their trade-off."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cube.cube_file import is_measured
from knitlab.cube.reduced_columns import with_reduction
from knitlab.cube.schema import Status
from knitlab.figures.cells import (
    DESIGN_NOTE,
    EMPTY,
    PERIODS_LABEL,
    CellStyle,
    draw_cells,
    marks_legend,
    measured_note,
    remove_frame,
    row_count,
    text_note,
    values_of,
)
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.labels import Label, place_labels
from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS
from knitlab.figures.trade_off import Design, pareto_front, values_of_designs
from knitlab.figures.value_colours import ValueColours
from knitlab.io.errors import fault

CAPACITANCE = "capacitance"
MARKERS = "osD^vP*X"
LETTERS_A_LINE, LETTERS_OF_BAR = 110, 18
MAP_ROW, MAP_MARGIN, TRADE_OFF = 0.38, 0.5, 3.1
"""Heights of a row of a map, of the space around it, and of the trade-off [in]."""
FEWEST_ROWS = 3
"""Smallest number of rows that a map has room for; its labels need it."""
NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


@dataclass(frozen=True)
class Merit:
    """A figure of merit of a sensor, which is better the larger it is.

    Attributes:
        name: variable of the cubes.
        label: name and unit.
        number: format of its values.
    """

    name: str
    label: str
    number: str


PAPER = (
    Merit("sensitivity", "sensitivity |dC/dε| [pF]", "{:.2f}"),
    Merit("working_range", "working range of applied strain [1]", "{:.0%}"),
)


def sensor_map(cubes: Sequence[xr.Dataset], window: str | None = None) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    With a ``window`` of applied strain, mean slope and linearity of the capacitance within it take
    their place. The Pareto front is joined and listed. Designs without a value are marked by
    status, so that a failure never looks like a value; measured ones have a dashed frame.

    Args:
        cubes: the cubes.
        window: the strains, such as ``0.1:0.3``.

    Raises:
        BadInput: if a cube is of fabrics without electrodes, or the window is not valid.
    """
    if any(CAPACITANCE not in cube for cube in cubes):
        raise fault("sensor", NEEDED)
    merits = PAPER
    if window is not None:
        merits, cubes = _within(window, cubes)
    rows = row_count(cubes)
    height = MAP_MARGIN + MAP_ROW * max(rows, FEWEST_ROWS)
    figure = Figure(figsize=(TWO_COLUMNS, 2 * height + TRADE_OFF), layout="constrained")
    first, second, below = figure.subplots(3, 1, height_ratios=(height, height, TRADE_OFF))
    marked, gaps = _map(figure, first, cubes, merits[0])
    more, _ = _map(figure, second, cubes, merits[1])
    second.set_xlabel(PERIODS_LABEL)
    notes = [*measured_note(cubes), text_note(f"{DESIGN_NOTE}, value")]
    if gaps:
        notes.append(text_note(EMPTY))
    marks_legend(figure, marked | more, NO_VALUE, notes)
    place_labels(figure, below, _trade_off(below, cubes, merits))
    return figure


def _within(
    window: str, cubes: Sequence[xr.Dataset]
) -> tuple[tuple[Merit, Merit], list[xr.Dataset]]:
    """Slope and linearity within a window, and the cubes with both."""
    found = []
    for cube in cubes:
        reduced, slope = with_reduction(cube, f"slope({CAPACITANCE}, {window})")
        reduced, straight = with_reduction(reduced, f"linearity({CAPACITANCE}, {window})")
        found.append(reduced.assign({slope: abs(reduced[slope])}))
    merits = (
        Merit(slope, f"|slope| of C over {window} [pF]", "{:.2f}"),
        Merit(straight, f"R² of a line over {window} [1]", "{:.2f}"),
    )
    return merits, found


def _map(
    figure: Figure, axes: Axes, cubes: Sequence[xr.Dataset], merit: Merit
) -> tuple[set[Status], bool]:
    colours = ValueColours.of(values_of(cubes, merit.name))
    style = CellStyle(merit.name, colours, lambda value, design: merit.number.format(value))
    marked = draw_cells(axes, cubes, style)
    remove_frame(axes)
    colours.bar(figure, axes, pad=0.01, label=fill(merit.label, LETTERS_OF_BAR))
    return marked


def _trade_off(axes: Axes, cubes: Sequence[xr.Dataset], merits: tuple[Merit, Merit]) -> list[Label]:
    """Draw both values of every design, and return the labels of the designs."""
    simulated, measured = (
        {
            design: values
            for cube in cubes
            if is_measured(cube) is experimental
            for design, values in values_of_designs(cube, *(merit.name for merit in merits)).items()
        }
        for experimental in (False, True)
    )
    plotted = simulated or measured
    stripes = sorted({n_stripe for n_stripe, _ in plotted})
    for n_stripe, colour, marker in zip(stripes, CATEGORY_COLOURS, MARKERS, strict=False):
        points = np.array([values for (n, _), values in plotted.items() if n == n_stripe])
        axes.plot(
            points[:, 1], points[:, 0], marker, color=colour, ms=4.5, label=f"n_stripe = {n_stripe}"
        )
    front = pareto_front(plotted)
    ends = np.array([plotted[design] for design in front]).reshape(-1, 2)
    axes.step(
        ends[:, 1], ends[:, 0], where="post", color="0.5", lw=0.8, zorder=0, label="Pareto front"
    )
    others = [design for design in plotted if design not in front]
    labels = [
        Label(plotted[design][1], plotted[design][0], f"{design}", colour=colour)
        for designs, colour in ((front, "black"), (others, "0.35"))
        for design in designs
    ]
    if simulated and measured:
        points = np.array(list(measured.values()))
        axes.plot(points[:, 1], points[:, 0], "o", ms=8, mfc="none", mec="black", label="measured")
        labels += [
            Label(width, sensitivity, f"{design} measured")
            for design, (sensitivity, width) in measured.items()
        ]
    axes.set(xlabel=merits[1].label, ylabel=merits[0].label)
    axes.margins(0.12)
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_title(_listed(front, plotted, merits), loc="left", fontsize=7, pad=20)
    if plotted:
        entries = len(axes.get_legend_handles_labels()[1])
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=entries, frameon=False)
    return labels


def _listed(
    front: list[Design],
    plotted: dict[Design, tuple[float, ...]],
    merits: tuple[Merit, Merit],
) -> str:
    """The Pareto front as text, in descending order of sensitivity."""
    first, second = (merit.number.format for merit in merits)
    each = [f"{d} {first(plotted[d][0])} pF, {second(plotted[d][1])}" for d in front]
    return fill(f"Pareto front: {'; '.join(each)}", LETTERS_A_LINE)


FIGURE = FigureKind(sensor_map, options=("window",), several="designs")
