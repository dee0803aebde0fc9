"""Maps of cells, each coloured by a value, or marked by status where there is none."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.cubes.cube_file import is_measured, parameters_of, source_of
from knitlab.figures.style import Look, ink_on, name_rows, number, value_colours
from knitlab.io.errors import InputError, invalid
from knitlab.observables.status import Status

MARKS: dict[Status, dict[str, Any]] = {
    Status.ok: {"facecolor": "white", "edgecolor": "0.6"},
    Status.pending: {"facecolor": "white", "edgecolor": "0.6", "hatch": "...."},
    Status.not_converged: {"facecolor": "white", "edgecolor": "black", "hatch": "////"},
    Status.failed: {"facecolor": "white", "edgecolor": "black", "hatch": "xxxx"},
    Status.excluded: {"facecolor": "none", "edgecolor": "none"},
}
"""Looks of cells without a value. What is excluded has no cell: no run can fill it."""
NAMES = {
    Status.pending: "not yet run",
    Status.not_converged: "not converged",
    Status.failed: "failed",
    Status.excluded: "no cell: no such design in this cube",
}
# With spaces where no line may end.
PERIODS_LABEL = (
    "P\u00a0=\u00a0n_subunit\u00a0/\u00a0(2\u00a0n_stripe): periods of a stripe across a patch"
)
LETTERS_IN_WIDTH = 130  # of a legend below a figure of two columns
MAX_NAMED = 16  # largest number of columns or rows that have a tick each
# Frame of a measured cell.
MEASURED: Look = {"edgecolor": "black", "linestyle": "--", "linewidth": 1.0, "zorder": 3}


def not_run() -> InputError:
    """The error of a figure for which no design has a value."""
    return invalid("designs", "none of this selection has been simulated; run it first")


def planned_designs(cube: xr.Dataset) -> list[xr.Dataset]:
    """The designs of a cube of checkerboards that are not excluded."""
    planned = np.argwhere(cube["status"].values != Status.excluded).tolist()
    return [cube.isel(n_stripe=row, n_subunit=column) for row, column in planned]


def design_name(design: xr.Dataset) -> str:
    """A design as text: ``(4, 16)``."""
    return f"({int(design['n_stripe'])}, {int(design['n_subunit'])})"


def pull_note(case: xr.Dataset) -> str:
    """Why strain is uneven along the pull of a case or cube; empty if it is in equilibrium."""
    motion = parameters_of(case).get("dynamics") or {}
    if motion.get("ending") != "time":
        return ""
    return f"pulled by {motion['strain_rate']:.1%} a ms: inertia keeps strain uneven along the pull"


def periods_of(design: xr.Dataset) -> float:
    """P of a design."""
    return float(design["n_subunit"]) / (2 * int(design["n_stripe"]))


def cell(
    axes: Axes,
    row: float,
    column: float,
    text: str = "",
    span: tuple[float, float] | None = None,
    letters: Mapping[str, Any] = {},
    **look: Any,
) -> None:
    """Draw a cell a unit wide, and a unit high unless its bottom and top are given, with a text."""
    bottom, top = span or (row - 0.5, row + 0.5)
    edge: Look = {"linewidth": 1.5, "edgecolor": "white"}
    axes.add_patch(Rectangle((column - 0.5, bottom), 1, top - bottom, **edge | look))
    if text:
        inside: Look = {"ha": "center", "va": "center", "color": ink_on(look["facecolor"])}
        axes.text(column, (bottom + top) / 2, text, zorder=4, **inside, **letters)


def number_table(
    axes: Axes, values: xr.DataArray, rows: str, columns: str, colours: ScalarMappable | None = None
) -> None:
    """Draw a table of numbers on colours, by default signed ones; missing ones are white."""
    numbers = values.transpose(rows, columns).values
    rgba = (colours or value_colours(numbers, signed=True)).to_rgba(numbers)
    axes.imshow(rgba)
    for row, column in np.argwhere(np.isfinite(numbers)).tolist():
        text, ink = number(float(numbers[row, column]), ".3g"), ink_on(rgba[row, column, :3])
        axes.text(column, row, text, ha="center", va="center", color=ink)
    name_rows(axes, [str(name) for name in values[rows].values])
    axes.set_xticks(range(numbers.shape[1]), [str(name) for name in values[columns].values])
    axes.set(xlabel=columns, ylabel=rows)
    remove_frame(axes)


def remove_frame(axes: Axes) -> None:
    """Remove the frame and the ticks of a map of cells."""
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def name_columns_and_rows(axes: Axes, columns: Sequence[str], rows: Sequence[str]) -> None:
    """Fit the axes to a map of cells, and name as many of its columns and rows as have room."""
    for axis, names in ((axes.xaxis, columns), (axes.yaxis, rows)):
        named = slice(None, None, 1 + (len(names) - 1) // MAX_NAMED)
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
