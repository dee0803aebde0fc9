"""Cells of a design map: coloured by a value, or marked by status where there is none."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.figures.sources import on_one_grid
from knitlab.io.cube_file import is_measured, source_of
from knitlab.io.design_status import Status
from knitlab.io.schema import DESIGN_DIMS

MARKS: dict[Status, dict[str, Any]] = {
    Status.ok: {"facecolor": "white", "edgecolor": "0.6"},
    Status.excluded: {"facecolor": "0.93", "edgecolor": "white"},
    Status.pending: {"facecolor": "white", "edgecolor": "0.6", "hatch": "...."},
    Status.not_converged: {"facecolor": "white", "edgecolor": "black", "hatch": "////"},
    Status.failed: {"facecolor": "white", "edgecolor": "black", "hatch": "xxxx"},
}
NAMES = {
    Status.excluded: "no such design, or not in this sweep",
    Status.ok: "no ratio: not stretched, or a single clamped cell",
    Status.pending: "not yet run",
    Status.not_converged: "not converged",
    Status.failed: "failed",
}


DASHED: dict[str, Any] = {
    "edgecolor": "black",
    "linestyle": "--",
    "linewidth": 1.0,
    "zorder": 3,
}
MEASURED_HEIGHT = 0.42
"""Of what is measured, in a cell that is simulated too."""

Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class CellStyle:
    """How the cells of a map show a value.

    Attributes:
        name: of the variable.
        colour: of a value.
        words: text in a cell of that value, given its cell of the cube.
    """

    name: str
    colour: Callable[[float], Colour]
    words: Callable[[float, xr.Dataset], str]


def draw_cells(axes: Axes, cubes: Sequence[xr.Dataset], look: CellStyle) -> set[Status]:
    """Draw a map of cells, and return the statuses that are marked in it.

    A design that is measured has a dashed frame; where it is simulated too, that is the strip
    at the foot of its cell.

    Args:
        axes: where to.
        cubes: of checkerboards; at most one is simulated.
        look: of the cells.
    """
    gridded = [cube.transpose(*DESIGN_DIMS, ...) for cube in on_one_grid(cubes)]
    first, *_ = gridded = sorted(gridded, key=is_measured)
    marked: set[Status] = set()
    for row, column in np.ndindex(first["status"].shape):
        here = [cube.isel(dict(zip(DESIGN_DIMS, (row, column), strict=True))) for cube in gridded]
        shown = [its for its in here if int(its["status"]) != Status.excluded] or here[:1]
        for place, its in enumerate(shown[:2]):
            code = Status(int(its["status"]))
            value = float(its[look.name]) if look.name in its else np.nan
            top = 0.5 if place == 0 else MEASURED_HEIGHT - 0.5
            foot = MEASURED_HEIGHT - 0.5 if place == 0 and len(shown) > 1 else -0.5
            if code is Status.ok and np.isfinite(value):
                colour = look.colour(value)
                edge = DASHED if is_measured(its) else {"edgecolor": "white"}
                cell(axes, row, column, bottom=row + foot, top=row + top, facecolor=colour, **edge)
                middle = row + (foot + top) / 2
                axes.text(
                    column,
                    middle,
                    look.words(value, its),
                    ha="center",
                    va="center",
                    color=ink_on(colour),
                    fontsize=7 if len(shown) == 1 else 5.5,
                    linespacing=0.95,
                    zorder=4,
                )
            else:
                cell(axes, row, column, bottom=row + foot, top=row + top, **MARKS[code])
                marked.add(code)
    rows, columns = first["status"].shape
    axes.set(
        xlim=(-0.5, columns - 0.5),
        ylim=(-0.5, rows - 0.5),
        xticks=range(columns),
        yticks=range(rows),
        xticklabels=first["n_subunit"].values,
        yticklabels=first["n_stripe"].values,
        ylabel="n_stripe: stitches\nacross a rib stripe",
    )
    return marked


def row_count(cubes: Sequence[xr.Dataset]) -> int:
    """Rows of a map of cubes: every n_stripe that one of them has."""
    return len({n for cube in cubes for n in cube["n_stripe"].values.tolist()})


def values_of(cubes: Sequence[xr.Dataset], name: str) -> np.ndarray:
    """All finite values of a variable in cubes."""
    found = [cube[name].values.ravel() for cube in cubes if name in cube]
    values = np.concatenate([np.empty(0), *found])
    return values[np.isfinite(values)]


def measured_note(cubes: Sequence[xr.Dataset]) -> list[Patch]:
    """What a dashed frame means, if cubes have one, for a legend."""
    names = ", ".join(dict.fromkeys(source_of(cube) for cube in cubes if is_measured(cube)))
    return [Patch(label=f"measured: {names}", facecolor="white", **DASHED)] if names else []


def cell(
    axes: Axes,
    row: int,
    column: float,
    bottom: float | None = None,
    top: float | None = None,
    **style: Any,
) -> None:
    """Draw one cell, a unit wide, and a unit high unless ``bottom`` and ``top`` are given."""
    low, high = row - 0.5 if bottom is None else bottom, row + 0.5 if top is None else top
    axes.add_patch(Rectangle((column - 0.5, low), 1, high - low, **{"linewidth": 1.5, **style}))


def frame(figure: Figure, axes: Axes, scale: ScalarMappable, **colorbar: Any) -> None:
    """Remove the frame and the ticks of a map of cells, and add a colour bar.

    Args:
        figure: the map's.
        axes: its axes.
        scale: norm and colours.
        colorbar: further arguments of the colour bar, such as its label.
    """
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    figure.colorbar(scale, ax=axes, pad=0.01, **colorbar)


def ink_on(colour: tuple[float, ...]) -> str:
    """Text colour that is legible on a colour: black or white."""
    luminance = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return "white" if luminance < 0.45 else "black"


def marks_legend(
    figure: Figure,
    marked: Collection[Status],
    no_value: str | None = None,
    notes: Sequence[Patch] = (),
) -> None:
    """Add a legend of the marks below a figure.

    Args:
        figure: the figure.
        marked: the statuses that are marked.
        no_value: why a design that is ok may have no value, if not as in the auxetic map.
        notes: further entries of the legend.
    """
    names = NAMES if no_value is None else NAMES | {Status.ok: no_value}
    handles = [*notes, *(Patch(label=names[code], **MARKS[code]) for code in sorted(marked))]
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=4, frameon=False)
