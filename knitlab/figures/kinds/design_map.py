"""Design maps over n_stripe and P: lowest Poisson's ratio, and sensitivity and working range."""

from collections.abc import Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cube.cube_file import is_measured
from knitlab.cube.schema import Status
from knitlab.cube.strain_window import with_columns
from knitlab.figures.cells import (
    EMPTY,
    PERIODS_LABEL,
    designs_of,
    draw_map,
    marks_legend,
    row_count,
)
from knitlab.figures.found_designs import non_dominated
from knitlab.figures.kinds import FigureKind
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, TWO_COLUMNS, Look, number
from knitlab.io.errors import fault

LARGE_SPREAD = 0.05  # of Poisson's ratio over the siblings of a design: the map states it
SPREAD_NOTE = "spread: difference in ν between slightly different fabrics, docs/how-to/spread.md"
CROSSES = "†"
CROSSES_NOTE = f"{CROSSES} the simulated fabric passes through itself there, which no real one can"
LAST = "‡"
LAST_NOTE = f"{LAST} lowest at the last strain of the test: ν may fall further"
ENDS_NOTE = f"{LAST} the test ends within the working range: it may be wider"
NO_RATIO = "no ratio: not stretched, or a single clamped cell"


def auxetic_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain at which it occurs.

    With one applied strain selected, it shows Poisson's ratio there. Designs without a value are
    hatched by status, so that a failure never looks like a value; measured ones have a dashed
    frame. Marks say where the fabric passes through itself, and where ν is lowest at the last
    strain. Where ν of the siblings of a design differs by more than 0.05 at any strain, the map
    states the difference.
    """
    if not any("poisson_ratio_min" in cube for cube in cubes):
        raise fault("auxetic", "shows Poisson's ratio, and there is none; import markers")
    strains = np.unique(np.concatenate([cube["applied_strain"].values for cube in cubes]))
    lowest = len(strains) > 1 or strains[0] == 0
    if not lowest:
        cubes = [cube.isel(applied_strain=0) for cube in cubes]

    def text(value: float, design: xr.Dataset) -> str:
        shown = f"{number(value)}{_crosses(design)}"
        if lowest:
            shown += f"{_last(design)}\nat {float(design['applied_strain_at_min']):.0%}"
        spread = _spread(design)
        return f"{shown}\nspread {spread:.2f}" if spread > LARGE_SPREAD else shown

    height = max(2.4, 1.2 + 0.5 * row_count(cubes))
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    axes = figure.add_subplot()
    name = "poisson_ratio_min" if lowest else "poisson_ratio"
    label = "lowest Poisson's ratio ν" if lowest else f"Poisson's ratio ν at {strains[0]:.0%}"
    label += "\n(negative: auxetic)"
    marked, gaps = draw_map(figure, axes, cubes, name, label, text, signed=True)
    axes.set_xlabel(PERIODS_LABEL)
    said = "lowest ν, and the applied strain there" if lowest else "ν"
    notes = [f"in each cell: (n_stripe, n_subunit), {said}", *([EMPTY] if gaps else [])]
    if any(_spread(cube) > LARGE_SPREAD for cube in cubes):
        notes.append(SPREAD_NOTE)
    shown = [design for cube in cubes for design in designs_of(cube)]
    if any(map(_crosses, shown)):
        notes.append(CROSSES_NOTE)
    if lowest and any(map(_last, shown)):
        notes.append(LAST_NOTE)
    marks_legend(figure, marked, NO_RATIO, notes, cubes)
    return figure


def _crosses(design: xr.Dataset) -> str:
    """A mark, if the fabric passes through itself where its Poisson's ratio is shown."""
    along = design["applied_strain"].ndim
    name = "intersections_at_min" if along else "self_intersections"
    return CROSSES if name in design and float(design[name]) > 0 else ""


def _last(design: xr.Dataset) -> str:
    """A mark, if Poisson's ratio is lowest at the last strain of the test."""
    last = float(design["applied_strain"].max())
    return LAST if float(design["applied_strain_at_min"]) >= last > 0 else ""


def _ends(design: xr.Dataset) -> str:
    """A mark, if the working range reaches the last strain of the test."""
    if "working_start" not in design:
        return ""
    end = float(design["working_start"] + design["working_range"])
    return LAST if end >= float(design["applied_strain"].max()) - 1e-9 else ""


def _spread(cube: xr.Dataset) -> float:
    """Largest spread of ν over siblings, at any strain of any design; NaN without siblings."""
    if "poisson_ratio_low" not in cube:
        return float("nan")
    return float((cube["poisson_ratio_high"] - cube["poisson_ratio_low"]).max())


NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


class Merit(NamedTuple):
    """A variable of the cubes that is better the larger it is, and the format of its values."""

    name: str
    label: str
    form: str

    def text(self, value: float, design: xr.Dataset | None = None) -> str:
        """A value as text, marked if the test of a design ended before its working range."""
        mark = ""
        if design is not None and self.name == "working_range":
            mark = _ends(design)
        return f"{format(value, self.form)}{mark}"


Merits = tuple[Merit, Merit]
PAPER = (
    Merit("sensitivity", "sensitivity |dC/dε| [pF]", ".2f"),
    Merit("working_range", "working range of applied strain [1]", ".0%"),
)


def sensor_map(cubes: Sequence[xr.Dataset], window: str | None = None) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    With a ``window`` of applied strain, such as ``0.1:0.3``, mean slope and linearity of the
    capacitance within it take their place. The Pareto front is joined, named and listed. Designs
    without a value are marked by status; measured ones have a dashed frame.
    """
    if any("capacitance" not in cube for cube in cubes):
        raise fault("sensor", NEEDED)
    merits: Merits = PAPER
    if window is not None:
        merits, cubes = _within(window, cubes)
    height = 0.5 + 0.38 * max(row_count(cubes), 3)
    figure = Figure(figsize=(TWO_COLUMNS, 2 * height + 3.1), layout="constrained")
    *maps, below = figure.subplots(3, 1, height_ratios=(height, height, 3.1))
    marked: set[Status] = set()
    for axes, merit in zip(maps, merits, strict=True):
        label = fill(merit.label, 18)
        more, gaps = draw_map(figure, axes, cubes, merit.name, label, merit.text)
        marked |= more
    maps[1].set_xlabel(PERIODS_LABEL)
    notes = ["in each cell: (n_stripe, n_subunit), value", *([EMPTY] if gaps else [])]
    if window is None and any(_ends(each) for cube in cubes for each in designs_of(cube)):
        notes.append(ENDS_NOTE)
    marks_legend(figure, marked, NO_VALUE, notes, cubes)
    _draw_trade_off(below, cubes, merits)
    return figure


def _within(window: str, cubes: Sequence[xr.Dataset]) -> tuple[Merits, list[xr.Dataset]]:
    slope, straight = (f"{name}(capacitance, {window})" for name in ("slope", "linearity"))
    reduced = [
        cube.assign({slope: abs(cube[slope])}) for cube in with_columns(cubes, [slope, straight])
    ]
    merits = (
        Merit(slope, f"|slope| of C over {window} [pF]", ".2f"),
        Merit(straight, f"R² of a line over {window} [1]", ".2f"),
    )
    return merits, reduced


def _draw_trade_off(axes: Axes, cubes: Sequence[xr.Dataset], merits: Merits) -> None:
    up, across = (merit.name for merit in merits)
    table = values_of_designs(cubes, merits)
    measured = table["measured"]
    shown = table if measured.all() else table[~measured]
    for (n_stripe, points), colour, marker in zip(
        shown.groupby("n_stripe"), CATEGORY_COLOURS, MARKERS, strict=False
    ):
        look: Look = {"color": colour, "ms": 4.5, "label": f"n_stripe = {n_stripe}"}
        axes.plot(points[across], points[up], marker, **look)
    front = shown[non_dominated(-shown[[up, across]].to_numpy())]
    front = front.sort_values([up, across], ascending=False)
    look = {"color": "0.5", "lw": 0.8, "zorder": 0, "label": "Pareto front"}
    axes.step(front[across], front[up], where="post", **look)
    named = front
    if len(shown) < len(table):
        named, points = pd.concat([front, table[measured]]), table[measured]
        axes.plot(points[across], points[up], "o", ms=8, mfc="none", mec="black", label="measured")
    for _, one in named.iterrows():
        name = f"({one['n_stripe']}, {one['n_subunit']})"
        name += " measured" if one["measured"] and not measured.all() else ""
        # Nothing lies above and to the right of the front, along which slanted names stay apart.
        beside: Look = {"xytext": (2, 2), "textcoords": "offset points", "rotation_mode": "anchor"}
        axes.annotate(name, (one[across], one[up]), rotation=45, fontsize=6, **beside)
    axes.set(xlabel=merits[1].label, ylabel=merits[0].label)
    axes.margins(0.2)
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    listed = [
        f"({one['n_stripe']}, {one['n_subunit']}) {merits[0].text(one[up])} pF,"
        f" {merits[1].text(one[across])}"
        for _, one in front.iterrows()
    ]
    title = fill(f"Pareto front: {'; '.join(listed)}", 110)
    axes.set_title(title, loc="left", fontsize=7, pad=20)
    if len(shown):
        entries = len(axes.get_legend_handles_labels()[1])
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=entries)


def values_of_designs(cubes: Sequence[xr.Dataset], merits: Merits) -> pd.DataFrame:
    """A row of both values for every design that is ok and has both."""
    names = [merit.name for merit in merits]
    table = pd.concat(
        cube[["status", *names]].to_dataframe().reset_index().assign(measured=is_measured(cube))
        for cube in cubes
    )
    return table[table["status"] == Status.ok].dropna(subset=names)


FIGURES = {
    "auxetic": FigureKind(auxetic_map, several="experiments", coordinates=("applied_strain",)),
    "sensor": FigureKind(sensor_map, options=("window",), several="experiments"),
}
