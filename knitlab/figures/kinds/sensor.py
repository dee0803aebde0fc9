"""Design map of capacitors: sensitivity, working range, and how they trade off."""

from collections.abc import Sequence
from math import dist
from string import ascii_lowercase
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cubes.cube_file import is_measured
from knitlab.cubes.strain_window import with_columns
from knitlab.cubes.trust import COLUMN, marks_of
from knitlab.figures.cells import marks_legend, planned_designs
from knitlab.figures.design_map import draw_map, explained, row_count, value_marks
from knitlab.figures.nearest_designs import non_dominated
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, Look, number, subplots
from knitlab.io.errors import invalid
from knitlab.observables.status import Status

NO_VALUE = "apart at too few strains to be read"
NEEDED = "needs electrodes on the fabric; run knitlab run sensor, or a workflow with [electrodes]"


class Merit(NamedTuple):
    """A variable of the cubes that is better the larger it is, and the format of its values."""

    name: str
    label: str
    form: str
    signed: str = ""  # variable with the sign of the value, if it has one

    def text(self, value: float, design: xr.Dataset) -> str:
        """The value of a design as text, with its sign and marks."""
        value = float(design[self.signed]) if self.signed else value
        return number(value, self.form) + value_marks(self.name, design)


SIGNED = "signed slope"
CLOSE = 0.05  # of the axes: points so close share one label
Merits = tuple[Merit, Merit]
PAPER = (
    Merit("sensitivity", "sensitivity |dC/dε| [pF]", "+.2f", SIGNED),
    Merit("working_range", "working range of applied strain [1]", ".0%"),
)


@figure(options=("window",), several="experiments")
def sensor(cubes: Sequence[xr.Dataset], window: str | None = None) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    With a ``window`` of applied strain, such as ``0.1:0.3``, mean slope and linearity of the
    capacitance within it take their place.
    """
    if any("capacitance" not in cube for cube in cubes):
        raise invalid("sensor", NEEDED)
    merits: Merits = PAPER
    if window is None:
        cubes = [cube.assign({SIGNED: _signed_sensitivity(cube)}) for cube in cubes]
    else:
        slope, straight = (f"{name}(capacitance, {window})" for name in ("slope", "linearity"))
        cubes = with_columns(cubes, [slope, straight])
        cubes = [cube.assign({slope: abs(cube[slope]), SIGNED: cube[slope]}) for cube in cubes]
        merits = (
            Merit(slope, f"|slope| of C over {window} [pF]", "+.2f", SIGNED),
            Merit(straight, f"R² of a line over {window} [1]", ".2f"),
        )
    designs = [design for cube in cubes for design in planned_designs(cube)]
    height = 0.5 + 0.38 * max(row_count(designs), 3)
    table = values_of_designs(cubes, merits)
    heights = [height, height, 3.1][: 3 if len(table) else 2]
    figure, (*maps, below) = subplots(sum(heights), len(heights), height_ratios=heights)
    maps = [*maps, below][:2]
    marked: set[Status] = set()
    for axes, merit in zip(maps, merits, strict=True):
        marked |= draw_map(axes, cubes, merit.name, fill(merit.label, 18), merit.text)
    maps[0].set_xlabel("")
    notes = ["in each cell: (n_stripe, n_subunit), value; −: C falls"]
    notes += explained([merit.name for merit in merits], designs)
    marks_legend(figure, marked, NO_VALUE, notes, cubes)
    if len(table):
        _draw_trade_off(below, table, merits)
    return figure


def _signed_sensitivity(cube: xr.Dataset) -> xr.DataArray:
    """The sensitivity with the sign of the change of the capacitance over the range of sensing."""
    strain = cube["applied_strain"]
    within = (strain >= cube["applied_strain_opened"]) & (strain <= cube["sensing_end"])
    change = cube["capacitance"].where(within).diff("applied_strain").sum("applied_strain")
    return cube["sensitivity"] * np.sign(change)


def _draw_trade_off(axes: Axes, table: pd.DataFrame, merits: Merits) -> None:
    (up, up_label, *_), (across, across_label, form, _) = merits
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
    labels: dict[tuple[float, float], str] = {}
    listed = []
    for letter, (_, one) in zip(ascii_lowercase, named.iterrows(), strict=False):
        at = one[across] / table[across].max(), one[up] / table[up].max()
        close = next((other for other in labels if dist(other, at) < CLOSE), at)
        labels[close] = ", ".join(filter(None, (labels.get(close), letter)))
        name = f"{letter} ({one['n_stripe']}, {one['n_subunit']}){one[COLUMN]}"
        name += " measured" if one["measured"] and not measured.all() else ""
        listed.append(f"{name} {one[up]:.2f} pF, {one[across]:{form}}")
    beside: Look = {"xytext": (4, 2), "textcoords": "offset points", "fontsize": 7}
    for (x, y), text in labels.items():
        # Nothing lies above and to the right of the front.
        axes.annotate(text, (x * table[across].max(), y * table[up].max()), **beside)
    axes.set(xlabel=across_label, ylabel=up_label)
    axes.margins(0.1, 0.15)  # with room for the letters
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_title(fill(f"Pareto front: {'; '.join(listed)}", 110), loc="left", fontsize=7, pad=20)
    entries = len(axes.get_legend_handles_labels()[1])
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=entries)


def values_of_designs(cubes: Sequence[xr.Dataset], merits: Merits) -> pd.DataFrame:
    """A row of both values for every design that is ok and has both."""
    names = [merit.name for merit in merits]
    table = pd.concat(
        cube[["status", *names]]
        .assign({COLUMN: marks_of(cube, names)})
        .to_dataframe()
        .reset_index()
        .assign(measured=is_measured(cube))
        for cube in cubes
    )
    return table[table["status"] == Status.ok].dropna(subset=names)
