"""Cells of a design map: coloured by a value, or marked by status where there is none."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.cube.cube_file import is_measured, source_of
from knitlab.cube.schema import Status
from knitlab.figures.value_colours import Colour

MARKS: dict[Status, dict[str, Any]] = {
    Status.ok: {"facecolor": "white", "edgecolor": "0.6"},
    Status.pending: {"facecolor": "white", "edgecolor": "0.6", "hatch": "...."},
    Status.not_converged: {"facecolor": "white", "edgecolor": "black", "hatch": "////"},
    Status.failed: {"facecolor": "white", "edgecolor": "black", "hatch": "xxxx"},
}
"""Looks of cells without a value. What is excluded has no cell: no run can fill it."""
NAMES = {
    Status.ok: "no ratio: not stretched, or a single clamped cell",
    Status.pending: "not yet run",
    Status.not_converged: "not converged",
    Status.failed: "failed",
}
EMPTY = "no cell: no such design in this cube"

DASHED: dict[str, Any] = {
    "edgecolor": "black",
    "linestyle": "--",
    "linewidth": 1.0,
    "zorder": 3,
}
MEASURED_HEIGHT = 0.42
"""Height of the measured part of a cell whose design is simulated too."""
INSET = 0.015
"""Distance of the frame of a measured part from its edge."""
DESIGN_SIZE, VALUE_SIZE, SMALL_VALUE_SIZE = 6, 7.5, 6
"""Sizes of the type in a cell [pt]."""


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


def draw_cells(
    axes: Axes, cubes: Sequence[xr.Dataset], style: CellStyle
) -> tuple[set[Status], bool]:
    """Draw a map of cells over n_stripe and P, and return what its legend must explain.

    P, the periods of a stripe across a patch, stands for n_subunit: every n_stripe has designs at
    the same few P, but at values of n_subunit of its own. Each cell names its design. A measured
    design has a dashed frame; where it is simulated too, the measurement is the strip at the
    bottom of its cell.

    Args:
        axes: axes to draw on.
        cubes: cubes of checkerboards, at most one of them simulated.
        style: how the cells show their value.

    Returns:
        The statuses that are marked, and whether there are places without a cell.
    """
    places: dict[tuple[int, float], list[xr.Dataset]] = {}
    for cube in sorted(cubes, key=is_measured):
        for design in designs_of(cube):
            places.setdefault(_place(design), []).append(design)
    stripes = sorted({n_stripe for n_stripe, _ in places})
    periods = sorted({p for _, p in places})
    marked: set[Status] = set()
    for (n_stripe, p), shown in places.items():
        row, column = stripes.index(n_stripe), periods.index(p)
        for k, design in enumerate(shown[:2]):
            status = Status(int(design["status"]))
            value = float(design[style.name]) if style.name in design else np.nan
            top = row + (0.5 if k == 0 else MEASURED_HEIGHT - 0.5)
            bottom = row + (MEASURED_HEIGHT - 0.5 if k == 0 and len(shown) > 1 else -0.5)
            if status is Status.ok and np.isfinite(value):
                colour = style.colour(value)
                look = {"facecolor": colour, "edgecolor": "white"}
                cell(axes, row, column, bottom=bottom, top=top, **look)
                if is_measured(design):
                    _frame_measured(axes, column, bottom, top, ink_on(colour))
                axes.text(
                    column,
                    (bottom + top) / 2,
                    style.text(value, design),
                    ha="center",
                    va="center",
                    color=ink_on(colour),
                    fontsize=VALUE_SIZE if len(shown) == 1 else SMALL_VALUE_SIZE,
                    linespacing=0.95,
                    zorder=4,
                )
            else:
                colour = (1.0, 1.0, 1.0, 1.0)
                cell(axes, row, column, bottom=bottom, top=top, **MARKS[status])
                marked.add(status)
            if k == 0:
                _name_design(axes, row, column, design, colour)
    axes.set(
        xlim=(-0.5, len(periods) - 0.5),
        ylim=(-0.5, len(stripes) - 0.5),
        xticks=range(len(periods)),
        yticks=range(len(stripes)),
        xticklabels=[f"{p:g}" for p in periods],
        yticklabels=stripes,
        ylabel="n_stripe: stitches\nacross a rib stripe",
    )
    return marked, len(places) < len(stripes) * len(periods)


def designs_of(cube: xr.Dataset) -> list[xr.Dataset]:
    """The designs of a cube of checkerboards that are not excluded."""
    rows, columns = np.nonzero(
        cube["status"].transpose("n_stripe", "n_subunit").values != Status.excluded
    )
    return [
        cube.isel(n_stripe=row, n_subunit=column)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    ]


def _place(design: xr.Dataset) -> tuple[int, float]:
    n_stripe, n_subunit = int(design["n_stripe"]), int(design["n_subunit"])
    return n_stripe, n_subunit / (2 * n_stripe)


def _frame_measured(axes: Axes, column: int, bottom: float, top: float, ink: str) -> None:
    corner = column - 0.5 + INSET, bottom + INSET
    size = 1 - 2 * INSET, top - bottom - 2 * INSET
    axes.add_patch(Rectangle(corner, *size, fill=False, **DASHED | {"edgecolor": ink}))


def _name_design(axes: Axes, row: int, column: int, design: xr.Dataset, colour: Colour) -> None:
    axes.annotate(
        f"({int(design['n_stripe'])}, {int(design['n_subunit'])})",
        (column - 0.5, row + 0.5),
        xytext=(3, -3),
        textcoords="offset points",
        va="top",
        fontsize=DESIGN_SIZE,
        color=ink_on(colour),
        zorder=4,
        bbox=None if colour != (1.0, 1.0, 1.0, 1.0) else {"fc": "white", "ec": "none", "pad": 0.8},
    )


PERIODS_LABEL = (
    "P\u00a0=\u00a0n_subunit\u00a0/\u00a0(2\u00a0n_stripe): periods of a stripe across a patch"
)
"""With spaces where no line may end."""
DESIGN_NOTE = "in each cell: (n_stripe, n_subunit)"


def row_count(cubes: Sequence[xr.Dataset]) -> int:
    """Rows of a map of cubes: every n_stripe that has a design in any of them."""
    return len({_place(design)[0] for cube in cubes for design in designs_of(cube)})


def values_of(cubes: Sequence[xr.Dataset], name: str) -> np.ndarray:
    """All finite values of a variable in cubes."""
    found = [cube[name].values.ravel() for cube in cubes if name in cube]
    values = np.concatenate([np.empty(0), *found])
    return values[np.isfinite(values)]


def measured_note(cubes: Sequence[xr.Dataset]) -> list[Artist]:
    """Legend entry of the dashed frames, if any cube is measured."""
    names = ", ".join(dict.fromkeys(source_of(cube) for cube in cubes if is_measured(cube)))
    return [Patch(label=f"measured: {names}", facecolor="white", **DASHED)] if names else []


def text_note(text: str) -> Patch:
    """Legend entry without a mark."""
    return Patch(label=text, facecolor="none", edgecolor="none")


def cell(
    axes: Axes,
    row: float,
    column: float,
    bottom: float | None = None,
    top: float | None = None,
    **style: Any,
) -> None:
    """Draw one cell, a unit wide, and a unit high unless ``bottom`` and ``top`` are given."""
    low, high = row - 0.5 if bottom is None else bottom, row + 0.5 if top is None else top
    axes.add_patch(Rectangle((column - 0.5, low), 1, high - low, **{"linewidth": 1.5, **style}))


def remove_frame(axes: Axes) -> None:
    """Remove the frame and the ticks of a map of cells."""
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def ink_on(colour: tuple[float, ...]) -> str:
    """Text colour that is legible on a colour: black or white."""
    luminance = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return "white" if luminance < 0.45 else "black"


def marks_legend(
    figure: Figure,
    marked: Collection[Status],
    no_value: str | None = None,
    notes: Sequence[Artist] = (),
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
        figure.legend(handles=handles, loc="outside lower left", ncols=3, frameon=False)
