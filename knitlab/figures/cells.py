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
"""Height of the measured part of a cell whose design is simulated too."""

Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class CellStyle:
    """How the cells of a map show a value.

    Attributes:
        name: the variable shown.
        colour: colour of a value.
        text: text of a cell, given its value and its cell of the cube.
    """

    name: str
    colour: Callable[[float], Colour]
    text: Callable[[float, xr.Dataset], str]


def draw_cells(axes: Axes, cubes: Sequence[xr.Dataset], style: CellStyle) -> set[Status]:
    """Draw a map of cells, and return the statuses that are marked in it.

    A measured design has a dashed frame; where it is simulated too, the measurement is the strip
    at the bottom of its cell.

    Args:
        axes: axes to draw on.
        cubes: cubes of checkerboards, at most one of them simulated.
        style: how the cells show their value.
    """
    gridded = [cube.transpose(*DESIGN_DIMS, ...) for cube in on_one_grid(cubes)]
    first, *_ = gridded = sorted(gridded, key=is_measured)
    marked: set[Status] = set()
    for row, column in np.ndindex(first["status"].shape):
        index = dict(zip(DESIGN_DIMS, (row, column), strict=True))
        designs = [cube.isel(index) for cube in gridded]
        shown = [each for each in designs if int(each["status"]) != Status.excluded] or designs[:1]
        for k, design in enumerate(shown[:2]):
            status = Status(int(design["status"]))
            value = float(design[style.name]) if style.name in design else np.nan
            top = row + (0.5 if k == 0 else MEASURED_HEIGHT - 0.5)
            bottom = row + (MEASURED_HEIGHT - 0.5 if k == 0 and len(shown) > 1 else -0.5)
            if status is Status.ok and np.isfinite(value):
                colour = style.colour(value)
                edge = DASHED if is_measured(design) else {"edgecolor": "white"}
                cell(axes, row, column, bottom=bottom, top=top, facecolor=colour, **edge)
                axes.text(
                    column,
                    (bottom + top) / 2,
                    style.text(value, design),
                    ha="center",
                    va="center",
                    color=ink_on(colour),
                    fontsize=7 if len(shown) == 1 else 5.5,
                    linespacing=0.95,
                    zorder=4,
                )
            else:
                cell(axes, row, column, bottom=bottom, top=top, **MARKS[status])
                marked.add(status)
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
    """Rows of a map of cubes: every n_stripe that occurs in any of them."""
    return len({n for cube in cubes for n in cube["n_stripe"].values.tolist()})


def values_of(cubes: Sequence[xr.Dataset], name: str) -> np.ndarray:
    """All finite values of a variable in cubes."""
    found = [cube[name].values.ravel() for cube in cubes if name in cube]
    values = np.concatenate([np.empty(0), *found])
    return values[np.isfinite(values)]


def measured_note(cubes: Sequence[xr.Dataset]) -> list[Patch]:
    """Legend entry of the dashed frames, if any cube is measured."""
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
        figure: the figure of the map.
        axes: the axes of the map.
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
        no_value: why a design that is ok may have no value; by default that of the auxetic map.
        notes: further entries of the legend.
    """
    names = NAMES if no_value is None else NAMES | {Status.ok: no_value}
    handles = [*notes, *(Patch(label=names[code], **MARKS[code]) for code in sorted(marked))]
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=4, frameon=False)
