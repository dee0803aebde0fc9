"""The sensor design map: sensitivity and working range of every design, and their trade-off."""

from collections.abc import Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cube.cube_file import is_measured
from knitlab.cube.reduced_columns import with_columns
from knitlab.cube.schema import Status
from knitlab.figures.cells import (
    EMPTY,
    PERIODS_LABEL,
    designs_of,
    draw_map,
    marks_legend,
    row_count,
)
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.found_designs import non_dominated
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, TWO_COLUMNS, Look
from knitlab.io.errors import fault

Design = tuple[int, int]
Values = tuple[float, float]
CAPACITANCE = "capacitance"
LETTERS_A_LINE, LETTERS_OF_BAR = 110, 18
MAP_ROW, MAP_MARGIN, TRADE_OFF = 0.38, 0.5, 3.1
"""Heights of a row of a map, of the space around it, and of the trade-off [in]."""
FEWEST_ROWS = 3
"""Smallest number of rows that a map has room for; its labels need it."""
NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


class Merit(NamedTuple):
    """A figure of merit of a sensor, which is better the larger it is: a variable of the cubes."""

    name: str
    label: str
    number: str

    def text(self, value: float, *_: object) -> str:
        """A value as text."""
        return self.number.format(value)


Merits = tuple[Merit, Merit]
PAPER = (
    Merit("sensitivity", "sensitivity |dC/dε| [pF]", "{:.2f}"),
    Merit("working_range", "working range of applied strain [1]", "{:.0%}"),
)


def sensor_map(cubes: Sequence[xr.Dataset], window: str | None = None) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    With a ``window`` of applied strain, mean slope and linearity of the capacitance within it take
    their place. The Pareto front is joined, named and listed. Designs without a value are marked by
    status, so that a failure never looks like a value; measured ones have a dashed frame.

    Args:
        cubes: the cubes.
        window: the strains, such as ``0.1:0.3``.
    """
    if any(CAPACITANCE not in cube for cube in cubes):
        raise fault("sensor", NEEDED)
    merits: Merits = PAPER
    if window is not None:
        merits, cubes = _within(window, cubes)
    height = MAP_MARGIN + MAP_ROW * max(row_count(cubes), FEWEST_ROWS)
    figure = Figure(figsize=(TWO_COLUMNS, 2 * height + TRADE_OFF), layout="constrained")
    *maps, below = figure.subplots(3, 1, height_ratios=(height, height, TRADE_OFF))
    marked: set[Status] = set()
    for axes, merit in zip(maps, merits, strict=True):
        label = fill(merit.label, LETTERS_OF_BAR)
        more, gaps = draw_map(figure, axes, cubes, merit.name, label, merit.text)
        marked |= more
    maps[1].set_xlabel(PERIODS_LABEL)
    notes = ["in each cell: (n_stripe, n_subunit), value", *([EMPTY] if gaps else [])]
    marks_legend(figure, marked, NO_VALUE, notes, cubes)
    _draw_trade_off(below, cubes, merits)
    return figure


def _within(window: str, cubes: Sequence[xr.Dataset]) -> tuple[Merits, list[xr.Dataset]]:
    """Slope and linearity within a window as merits, and the cubes with both."""
    slope, straight = (f"{name}({CAPACITANCE}, {window})" for name in ("slope", "linearity"))
    reduced = []
    for cube in cubes:
        (cube,) = with_columns([cube], [slope, straight])
        reduced.append(cube.assign({slope: abs(cube[slope])}))
    merits = (
        Merit(slope, f"|slope| of C over {window} [pF]", "{:.2f}"),
        Merit(straight, f"R² of a line over {window} [1]", "{:.2f}"),
    )
    return merits, reduced


def _draw_trade_off(axes: Axes, cubes: Sequence[xr.Dataset], merits: Merits) -> None:
    """Draw the second value of every design across and the first up, and name the Pareto front."""
    simulated = values_of_designs([cube for cube in cubes if not is_measured(cube)], merits)
    measured = values_of_designs([cube for cube in cubes if is_measured(cube)], merits)
    plotted = simulated or measured
    stripes = sorted({n_stripe for n_stripe, _ in plotted})
    for n_stripe, colour, marker in zip(stripes, CATEGORY_COLOURS, MARKERS, strict=False):
        points = np.array([values for (n, _), values in plotted.items() if n == n_stripe])
        label = f"n_stripe = {n_stripe}"
        axes.plot(points[:, 1], points[:, 0], marker, color=colour, ms=4.5, label=label)
    front = pareto_front(plotted)
    ends = np.array([plotted[design] for design in front]).reshape(-1, 2)
    step: Look = {"where": "post", "color": "0.5", "lw": 0.8, "zorder": 0}
    axes.step(ends[:, 1], ends[:, 0], label="Pareto front", **step)
    named = [(plotted[design], f"{design}") for design in front]
    if simulated and measured:
        points = np.array(list(measured.values()))
        axes.plot(points[:, 1], points[:, 0], "o", ms=8, mfc="none", mec="black", label="measured")
        named += [(values, f"{design} measured") for design, values in measured.items()]
    for (up, across), name in named:
        # Nothing lies above and to the right of the front, along which slanted names stay apart.
        beside: Look = {"xytext": (2, 2), "textcoords": "offset points", "rotation_mode": "anchor"}
        axes.annotate(name, (across, up), rotation=45, fontsize=6, **beside)
    axes.set(xlabel=merits[1].label, ylabel=merits[0].label)
    axes.margins(0.2)
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    first, second = (merit.text for merit in merits)
    listed = [f"{each} {first(plotted[each][0])} pF, {second(plotted[each][1])}" for each in front]
    title = fill(f"Pareto front: {'; '.join(listed)}", LETTERS_A_LINE)
    axes.set_title(title, loc="left", fontsize=7, pad=20)
    if plotted:
        entries = len(axes.get_legend_handles_labels()[1])
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=entries)


def values_of_designs(cubes: Sequence[xr.Dataset], merits: Merits) -> dict[Design, Values]:
    """Both values by design; only of designs that are ok and have both."""
    values = {
        (int(design["n_stripe"]), int(design["n_subunit"])): (
            float(design[merits[0].name]),
            float(design[merits[1].name]),
        )
        for cube in cubes
        for design in designs_of(cube)
        if int(design["status"]) == Status.ok
    }
    return {design: both for design, both in values.items() if np.isfinite(both).all()}


def pareto_front(values: dict[Design, Values]) -> list[Design]:
    """The designs that no other exceeds in one value and equals in the other, the best first."""
    if not values:
        return []
    on_front = non_dominated(-np.array(list(values.values())))
    front = [design for design, kept in zip(values, on_front, strict=True) if kept]
    return sorted(front, key=lambda design: values[design], reverse=True)


FIGURE = FigureKind(sensor_map, options=("window",), several="designs")
