"""Design maps over n_stripe and P: lowest Poisson's ratio, and sensitivity and working range."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from math import dist
from textwrap import fill
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from knitlab.cubes.cube_file import is_measured
from knitlab.cubes.strain_window import with_columns
from knitlab.cubes.trust import COLUMN, MARKS, marked, marks_of
from knitlab.figures import cells, style
from knitlab.figures.cells import cell, design_name, designs_of, marks_legend
from knitlab.figures.kinds import FigureKind
from knitlab.figures.nearest_designs import non_dominated
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, Look, number, subplots
from knitlab.io.errors import invalid
from knitlab.observables.schema import Status

LARGE_SPREAD = 0.05  # of Poisson's ratio over the siblings of a design: the map states it
SPREAD_NOTE = "spread: difference in ν between slightly different fabrics, docs/how-to/spread.md"
LAST = "‡ lowest at the last strain of the test: ν may fall further"
ENDS = "‡ the test ends within the working range: it may be wider"
NO_RATIO = "no ratio: not stretched, or a single clamped cell"


def auxetic_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain at which it occurs.

    With one applied strain selected, it shows Poisson's ratio there. Where ν of the siblings of a
    design differs by more than 0.05 at any strain, the map states the difference.
    """
    if not any("poisson_ratio_min" in cube for cube in cubes):
        raise invalid("auxetic", "shows Poisson's ratio, and there is none; import markers")
    strains = np.unique(np.concatenate([cube["applied_strain"].values for cube in cubes]))
    lowest = len(strains) > 1 or strains[0] == 0
    if not lowest:
        cubes = [cube.isel(applied_strain=0) for cube in cubes]
    name = "poisson_ratio_min" if lowest else "poisson_ratio"
    designs = [design for cube in cubes for design in designs_of(cube)]

    def text(value: float, design: xr.Dataset) -> str:
        shown = f"{number(value)}{_marks(name, design)}"
        if lowest:
            shown += f"\nat {float(design['applied_strain_at_min']):.0%}"
        spread = _spread(design)
        return f"{shown}\nspread {spread:.2f}" if spread > LARGE_SPREAD else shown

    figure, axes = subplots(max(2.4, 1.2 + 0.5 * row_count(designs)))
    label = "lowest Poisson's ratio ν" if lowest else f"Poisson's ratio ν at {strains[0]:.0%}"
    label += "\n(negative: auxetic)"
    marked = draw_map(axes, cubes, name, label, text, signed=True)
    said = "lowest ν, and the applied strain there" if lowest else "ν"
    notes = [f"in each cell: (n_stripe, n_subunit), {said}"]
    if any(_spread(cube) > LARGE_SPREAD for cube in cubes):
        notes.append(SPREAD_NOTE)
    notes += _explained([name], designs)
    marks_legend(figure, marked, NO_RATIO, notes, cubes)
    return figure


def draw_map(
    axes: Axes,
    cubes: Sequence[xr.Dataset],
    name: str,
    label: str,
    text: Callable[[float, xr.Dataset], str],
    signed: bool = False,
) -> set[Status]:
    """Draw a map of cells over n_stripe and P, with its colour bar; the statuses that it marks.

    A measured design has a dashed frame; if it is simulated too, the measurement is the strip at
    the bottom of its cell. Several experiments on one design are refused.
    """
    values = [cube[name].values.ravel() for cube in cubes if name in cube]
    colours = style.value_colours(np.concatenate([np.empty(0), *values]), signed)
    by_cell = defaultdict[tuple[int, float], list[xr.Dataset]](list)
    for design in chain.from_iterable(map(designs_of, sorted(cubes, key=is_measured))):
        n_stripe, n_subunit = int(design["n_stripe"]), int(design["n_subunit"])
        by_cell[n_stripe, n_subunit / (2 * n_stripe)].append(design)
    if any(sum(map(is_measured, designs)) > 1 for designs in by_cell.values()):
        raise invalid("experiments", "there are several on one design; show one of them")
    stripes, periods = (sorted({each[k] for each in by_cell}) for k in (0, 1))
    marked = {Status.excluded} if len(by_cell) < len(stripes) * len(periods) else set[Status]()
    for (n_stripe, p), designs in by_cell.items():
        row, column = stripes.index(n_stripe), periods.index(p)
        border = row - 0.5 + (0.42 if len(designs) > 1 else 0)
        spans = (border, row + 0.5), (row - 0.5, border)
        for design, (bottom, top) in zip(designs, spans, strict=False):
            status = Status(int(design["status"]))
            value = float(design[name]) if name in design else np.nan
            valid = status is Status.ok and np.isfinite(value)
            look: Look = (
                {"facecolor": colours.to_rgba(np.array(value))} if valid else cells.MARKS[status]
            )
            ink = style.ink_on(look["facecolor"])
            if design is designs[0]:
                at: Look = {"xytext": (3, -3), "textcoords": "offset points", "va": "top"}
                # Of a mark the name hides the hatching.
                box = None if valid else {"fc": "white", "ec": "none", "pad": 0.8}
                at |= {"fontsize": 6, "color": ink, "zorder": 4, "bbox": box}
                axes.annotate(design_name(design), (column - 0.5, row + 0.5), **at)
            shown = text(float(value), design) if valid else ""
            letters: Look = {"fontsize": 7.5 if len(designs) == 1 else 6, "linespacing": 0.95}
            cell(axes, row, column, shown, (bottom, top), letters, **look)
            if not valid:
                marked.add(status)
            elif is_measured(design):
                inset, frame = 0.015, cells.MEASURED | {"edgecolor": ink}
                corner = column - 0.5 + inset, bottom + inset
                size = 1 - 2 * inset, top - bottom - 2 * inset
                axes.add_patch(Rectangle(corner, *size, fill=False, **frame))
    cells.name_columns_and_rows(axes, [f"{p:g}" for p in periods], list(map(str, stripes)))
    axes.set(xlabel=cells.PERIODS_LABEL, ylabel="n_stripe: stitches\nacross a rib stripe")
    style.colour_bar(axes, colours, pad=0.01, label=label)
    return marked


def _notes(name: str, design: xr.Dataset) -> list[str]:
    """Notes on a value of a design, each of which begins with its mark."""
    last = float(design["applied_strain"].max())
    notes = [str(MARKS[mark]) for mark, where in marked(design, [name]).items() if where]
    if name == "poisson_ratio_min" and float(design["applied_strain_at_min"]) >= last > 0:
        notes.append(LAST)
    if name == "working_range" and "working_start" in design:
        end = float(design["working_start"] + design["working_range"])
        notes += [ENDS] if end >= last - 1e-9 else []
    return notes


def _marks(name: str, design: xr.Dataset) -> str:
    return "".join(note[0] for note in _notes(name, design))


def _explained(names: Sequence[str], designs: Iterable[xr.Dataset]) -> list[str]:
    """The notes on some values of designs, each once, in the order of the marks of tables."""
    shown = {note for design in designs for name in names for note in _notes(name, design)}
    return [note for note in (*map(str, MARKS.values()), LAST, ENDS) if note in shown]


def row_count(designs: Sequence[xr.Dataset]) -> int:
    """Number of rows of a map of designs."""
    return len({int(design["n_stripe"]) for design in designs})


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
    signed: str = ""  # variable with the sign of the value, if it has one

    def text(self, value: float, design: xr.Dataset) -> str:
        """The value of a design as text, with its sign and marks."""
        value = float(design[self.signed]) if self.signed else value
        return number(value, self.form) + _marks(self.name, design)


SIGNED = "signed slope"
CLOSE = 0.05  # of the axes: points so close share one label
Merits = tuple[Merit, Merit]
PAPER = (
    Merit("sensitivity", "sensitivity |dC/dε| [pF]", ".2f"),
    Merit("working_range", "working range of applied strain [1]", ".0%"),
)


def sensor_map(cubes: Sequence[xr.Dataset], window: str | None = None) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    With a ``window`` of applied strain, such as ``0.1:0.3``, mean slope and linearity of the
    capacitance within it take their place.
    """
    if any("capacitance" not in cube for cube in cubes):
        raise invalid("sensor", NEEDED)
    merits: Merits = PAPER
    if window is not None:
        slope, straight = (f"{name}(capacitance, {window})" for name in ("slope", "linearity"))
        cubes = with_columns(cubes, [slope, straight])
        cubes = [cube.assign({slope: abs(cube[slope]), SIGNED: cube[slope]}) for cube in cubes]
        merits = (
            Merit(slope, f"|slope| of C over {window} [pF]", "+.2f", SIGNED),
            Merit(straight, f"R² of a line over {window} [1]", ".2f"),
        )
    designs = [design for cube in cubes for design in designs_of(cube)]
    height = 0.5 + 0.38 * max(row_count(designs), 3)
    heights = height, height, 3.1
    figure, (*maps, below) = subplots(sum(heights), 3, height_ratios=heights)
    marked: set[Status] = set()
    for axes, merit in zip(maps, merits, strict=True):
        label = fill(merit.label, 18)
        marked |= draw_map(axes, cubes, merit.name, label, merit.text)
    maps[0].set_xlabel("")
    notes = ["in each cell: (n_stripe, n_subunit), value"]
    notes += _explained([merit.name for merit in merits], designs)
    marks_legend(figure, marked, NO_VALUE, notes, cubes)
    _draw_trade_off(below, cubes, merits)
    return figure


def _draw_trade_off(axes: Axes, cubes: Sequence[xr.Dataset], merits: Merits) -> None:
    (up, up_label, *_), (across, across_label, form, _) = merits
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
    labels: dict[tuple[float, float], str] = {}
    for _, one in named.iterrows():
        name = f"({one['n_stripe']}, {one['n_subunit']}){one[COLUMN]}"
        name += " measured" if one["measured"] and not measured.all() else ""
        at = one[across] / table[across].max(), one[up] / table[up].max()
        close = next((other for other in labels if dist(other, at) < CLOSE), at)
        labels[close] = ", ".join(filter(None, (labels.get(close), name)))
    for (x, y), text in labels.items():
        # Nothing lies above and to the right of the front, along which slanted names stay apart.
        beside: Look = {"xytext": (2, 2), "textcoords": "offset points", "rotation_mode": "anchor"}
        at = x * table[across].max(), y * table[up].max()
        axes.annotate(text, at, rotation=45, fontsize=6, **beside)
    axes.set(xlabel=across_label, ylabel=up_label)
    axes.margins(0.2, 0.35)  # with room for the names
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    listed = [
        f"({one['n_stripe']}, {one['n_subunit']}){one[COLUMN]} {one[up]:.2f} pF,"
        f" {one[across]:{form}}"
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
        cube[["status", *names]]
        .assign({COLUMN: marks_of(cube, names)})
        .to_dataframe()
        .reset_index()
        .assign(measured=is_measured(cube))
        for cube in cubes
    )
    return table[table["status"] == Status.ok].dropna(subset=names)


FIGURES = {
    "auxetic": FigureKind(auxetic_map, several="experiments", coordinates=("applied_strain",)),
    "sensor": FigureKind(sensor_map, options=("window",), several="experiments"),
}
