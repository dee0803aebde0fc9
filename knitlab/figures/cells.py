"""Maps of cells, each coloured by a value, or marked by status where there is none."""

from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from itertools import chain
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.cube.cube_file import is_measured, source_of
from knitlab.cube.schema import Status
from knitlab.figures.style import Colour, Look, ValueColours, ink_on
from knitlab.io.errors import fault

MARKS: dict[Status, dict[str, Any]] = {
    Status.ok: {"facecolor": "white", "edgecolor": "0.6"},
    Status.pending: {"facecolor": "white", "edgecolor": "0.6", "hatch": "...."},
    Status.not_converged: {"facecolor": "white", "edgecolor": "black", "hatch": "////"},
    Status.failed: {"facecolor": "white", "edgecolor": "black", "hatch": "xxxx"},
}
"""Looks of cells without a value. What is excluded has no cell: no run can fill it."""
NAMES = {
    Status.pending: "not yet run",
    Status.not_converged: "not converged",
    Status.failed: "failed",
}
EMPTY = "no cell: no such design in this cube"
# With spaces where no line may end.
PERIODS_LABEL = (
    "P\u00a0=\u00a0n_subunit\u00a0/\u00a0(2\u00a0n_stripe): periods of a stripe across a patch"
)
LETTERS_IN_WIDTH = 130  # of a legend below a figure of two columns
MOST_NAMED = 16  # largest number of columns or rows that have a tick each
# Frame of a measured cell.
MEASURED: Look = {"edgecolor": "black", "linestyle": "--", "linewidth": 1.0, "zorder": 3}
WHITE: Colour = (1.0, 1.0, 1.0, 1.0)


def draw_map(
    figure: Figure,
    axes: Axes,
    cubes: Sequence[xr.Dataset],
    name: str,
    label: str,
    text: Callable[[float, xr.Dataset], str],
    signed: bool = False,
) -> tuple[set[Status], bool]:
    """Draw a map of cells over n_stripe and P, with its colour bar.

    A measured design has a dashed frame; if it is simulated too, the measurement is the strip at
    the bottom of its cell. Returned are the statuses that are marked, and whether there are gaps
    between the cells. Several experiments on one design are refused.
    """
    values = [cube[name].values.ravel() for cube in cubes if name in cube]
    colours = ValueColours.of(np.concatenate([np.empty(0), *values]), signed)
    cells = defaultdict[tuple[int, float], list[xr.Dataset]](list)
    for design in chain.from_iterable(map(designs_of, sorted(cubes, key=is_measured))):
        n_stripe, n_subunit = int(design["n_stripe"]), int(design["n_subunit"])
        cells[n_stripe, n_subunit / (2 * n_stripe)].append(design)
    if any(sum(map(is_measured, designs)) > 1 for designs in cells.values()):
        raise fault("experiments", "there are several on one design; show one of them")
    stripes, periods = (sorted({each[k] for each in cells}) for k in (0, 1))
    marked: set[Status] = set()
    for (n_stripe, p), designs in cells.items():
        row, column = stripes.index(n_stripe), periods.index(p)
        border = row - 0.5 + (0.42 if len(designs) > 1 else 0)
        spans = (border, row + 0.5), (row - 0.5, border)
        for design, (bottom, top) in zip(designs, spans, strict=False):
            status = Status(int(design["status"]))
            value = float(design[name]) if name in design else np.nan
            valid = status is Status.ok and np.isfinite(value)
            colour = colours(value) if valid else WHITE
            if design is designs[0]:
                at: Look = {"xytext": (3, -3), "textcoords": "offset points", "va": "top"}
                # Of a mark the name hides the hatching.
                box = {"fc": "white", "ec": "none", "pad": 0.8} if colour == WHITE else None
                at |= {"fontsize": 6, "color": ink_on(colour), "zorder": 4, "bbox": box}
                axes.annotate(design_name(design), (column - 0.5, row + 0.5), **at)
            if not valid:
                cell(axes, row, column, (bottom, top), **MARKS[status])
                marked.add(status)
                continue
            look: Look = {"fontsize": 7.5 if len(designs) == 1 else 6, "linespacing": 0.95}
            value_cell(axes, row, column, colour, text(value, design), (bottom, top), **look)
            if is_measured(design):
                inset, frame = 0.015, MEASURED | {"edgecolor": ink_on(colour)}
                corner = column - 0.5 + inset, bottom + inset
                size = 1 - 2 * inset, top - bottom - 2 * inset
                axes.add_patch(Rectangle(corner, *size, fill=False, **frame))
    name_columns_and_rows(axes, [f"{p:g}" for p in periods], list(map(str, stripes)))
    axes.set_ylabel("n_stripe: stitches\nacross a rib stripe")
    colours.bar(figure, axes, pad=0.01, label=label)
    return marked, len(cells) < len(stripes) * len(periods)


def designs_of(cube: xr.Dataset) -> list[xr.Dataset]:
    """The designs of a cube of checkerboards that are not excluded."""
    status = cube["status"].transpose("n_stripe", "n_subunit").values
    return [
        cube.isel(n_stripe=row, n_subunit=column)
        for row, column in np.argwhere(status != Status.excluded).tolist()
    ]


def design_name(design: xr.Dataset) -> str:
    """A design as text: ``(4, 16)``."""
    return f"({int(design['n_stripe'])}, {int(design['n_subunit'])})"


def cell(
    axes: Axes, row: float, column: float, span: tuple[float, float] | None = None, **look: Any
) -> None:
    """Draw one cell, a unit wide, and a unit high unless its bottom and top are given."""
    bottom, top = span or (row - 0.5, row + 0.5)
    axes.add_patch(Rectangle((column - 0.5, bottom), 1, top - bottom, **{"linewidth": 1.5} | look))


def value_cell(
    axes: Axes,
    row: float,
    column: float,
    colour: Colour,
    text: str,
    span: tuple[float, float] | None = None,
    **letters: Any,
) -> None:
    """Draw a cell in the colour of its value, with a text; one without text is small."""
    edge = {"edgecolor": "white"} if text else {"edgecolor": colour, "linewidth": 0.2}
    cell(axes, row, column, span, facecolor=colour, **edge)
    middle = row if span is None else sum(span) / 2
    if text:
        look: Look = {"ha": "center", "va": "center", "color": ink_on(colour), "zorder": 4}
        axes.text(column, middle, text, **look, **letters)


def remove_frame(axes: Axes) -> None:
    """Remove the frame and the ticks of a map of cells."""
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def name_columns_and_rows(axes: Axes, columns: Sequence[str], rows: Sequence[str]) -> None:
    """Fit the axes to a map of cells, and name as many of its columns and rows as have room."""
    for axis, names in ((axes.xaxis, columns), (axes.yaxis, rows)):
        named = slice(None, None, 1 + (len(names) - 1) // MOST_NAMED)
        axis.set_ticks(range(len(names))[named], names[named])
    axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(-0.5, len(rows) - 0.5))
    remove_frame(axes)


def marks_legend(
    figure: Figure,
    marked: Collection[Status],
    no_value: str,
    notes: Sequence[str] = (),
    cubes: Sequence[xr.Dataset] = (),
) -> None:
    """Add a legend of marked statuses (``no_value``: of a design that is ok), notes and frames."""
    names = NAMES | {Status.ok: no_value}
    handles: list[Artist] = []
    if sources := dict.fromkeys(source_of(cube) for cube in cubes if is_measured(cube)):
        label = f"measured: {', '.join(sources)}"
        handles.append(Patch(label=label, facecolor="white", **MEASURED))
    handles += [Patch(label=text, facecolor="none", edgecolor="none") for text in notes]
    handles += [Patch(label=names[status], **MARKS[status]) for status in sorted(marked)]
    if handles:
        longest = max(len(str(handle.get_label())) for handle in handles)
        columns = max(1, min(3, LETTERS_IN_WIDTH // longest))
        figure.legend(handles=handles, loc="outside lower left", ncols=columns)
