"""The sensor design map: how steep and over what range every design senses, and the trade-off."""

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
from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.figures.trade_off import Design, pareto_front, values_of_designs
from knitlab.io.cube_file import is_measured
from knitlab.io.design_status import Status
from knitlab.io.errors import fault

STEEPNESS, RANGE = "sensitivity", "working_range"
MARKERS = "osD^vP*X"
LETTERS_A_LINE = 110
MAP_ROW, MAP_MARGIN, TRADE_OFF = 0.32, 0.5, 3.1
"""Heights of a row of a map, of the space around it, and of the trade-off [in]."""
FEWEST_ROWS = 3
"""Least rows that a map has room for; its labels need them."""
NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


def sensor_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Sensitivity and working range of every design, and one against the other.

    Designs that no other beats in both are joined and listed. Designs without a value are marked
    by status, so that a failure never looks like one; measured ones have a dashed frame.

    Raises:
        BadInput: if a cube is of fabrics without electrodes.
    """
    if any(STEEPNESS not in cube for cube in cubes):
        raise fault("sensor", NEEDED)
    rows = row_count(cubes)
    height = MAP_MARGIN + MAP_ROW * max(rows, FEWEST_ROWS)
    figure = Figure(figsize=(TWO_COLUMNS, 2 * height + TRADE_OFF), layout="constrained")
    first, second, below = figure.subplots(3, 1, height_ratios=(height, height, TRADE_OFF))
    marked = _map(figure, first, cubes, STEEPNESS, "sensitivity\n|dC/dε| [pF]", "{:.2f}")
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
    look = CellStyle(
        name, lambda value: colours(norm(value)), lambda value, its: number.format(value)
    )
    marked = draw_cells(axes, cubes, look)
    frame(figure, axes, mpl.cm.ScalarMappable(norm, colours), label=label)
    return marked


def _trade_off(axes: Axes, cubes: Sequence[xr.Dataset]) -> None:
    simulated, measured = (
        {
            design: its
            for cube in cubes
            if is_measured(cube) is kind
            for design, its in values_of_designs(cube, STEEPNESS, RANGE).items()
        }
        for kind in (False, True)
    )
    figures = simulated or measured
    stripes = sorted({n_stripe for n_stripe, _ in figures})
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.85, max(len(stripes), 1)))
    for n_stripe, shade, marker in zip(stripes, shades, MARKERS, strict=False):
        points = np.array([its for (n, _), its in figures.items() if n == n_stripe])
        axes.plot(
            points[:, 1], points[:, 0], marker, color=shade, ms=5, label=f"n_stripe = {n_stripe}"
        )
    front = pareto_front(figures)
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
    if simulated:
        for design, (steepness, width) in measured.items():
            axes.plot(width, steepness, "o", ms=8, mfc="none", mec="black", ls="")
            axes.annotate(
                f"{design} measured",
                (width, steepness),
                xytext=(7, -7),
                textcoords="offset points",
                fontsize=6.5,
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
