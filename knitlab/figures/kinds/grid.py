"""A grid: any variable of a cube over any two of its dimensions."""

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from knitlab.cube.cube_file import design_dims
from knitlab.cube.reduced_columns import with_reduction
from knitlab.cube.schema import COORDINATES, FLAGS, Status
from knitlab.cube.selection import choices
from knitlab.figures.cells import EMPTY, MARKS, PERIODS_LABEL, ink_on, marks_legend, text_note
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.grid_axis import GridAxis
from knitlab.figures.periods import PERIODS, by_periods, has_periods
from knitlab.figures.style import TWO_COLUMNS, number
from knitlab.figures.value_colours import ValueColours
from knitlab.io.errors import fault, unknown

MOST_COLUMNS, MOST_ROWS = 16, 24
"""Largest numbers of columns and rows whose cells still have room for a number."""
ROW, MARGIN = 0.3, 1.3
"""Height of a row, and of what is around the grid [in]."""
LOWEST, HIGHEST = 2.4, 6.5
"""Limits of the height of the figure [in]."""
LETTERS = 26
"""Letters on a line of an upright label."""
NO_VALUE = "no value there"


def value_grid(
    cube: xr.Dataset,
    x: str | None = None,
    y: str | None = None,
    of: str = "poisson_ratio_min",
) -> Figure:
    """Any variable over any two dimensions of a cube, swept settings included.

    A place where no design can be, or none was planned, stays empty; a design without a value is
    marked by status. Every other dimension needs one selected value. Without ``x`` and ``y`` the
    dimensions are those with more than one value, with P in place of n_subunit.

    Args:
        cube: the cube.
        x: dimension across, or ``periods`` for P = n_subunit / (2 n_stripe).
        y: dimension up, or ``periods``.
        of: the variable, or a reduction of one along the strain, as in queries:
            ``slope(capacitance, 0.1:0.3)``.

    Raises:
        BadInput: if there is no such variable or dimension, or another one has several values.
    """
    cube, of = with_reduction(cube, of)
    if of not in cube.data_vars:
        raise fault("of", unknown(of, map(str, cube.data_vars), "variable"))
    if of in FLAGS or cube[of].dtype.kind not in "iuf":
        raise fault("of", f"{of} is not a number; choose a variable with a unit")
    if PERIODS in (x, y) or (x is y is None and has_periods(cube) and _varies_by_design(cube, of)):
        if not has_periods(cube):
            raise fault("x" if x == PERIODS else "y", "pure stripes have no P; choose n")
        units = cube[of].attrs
        cube = by_periods(cube if of != PERIODS else cube.rename({PERIODS: "P"}))
        of = "P" if of == PERIODS else of
        cube[of].attrs |= units
    x, y = _axes(cube[of], x, y)
    values, status, fixed = _plane(cube, x, y, of)
    used = status != Status.excluded
    kept = {dim: used.any(other).values for dim, other in ((x, y), (y, x))}
    if not used.any():
        raise fault("grid", "no design of this selection was planned; choose others")
    values, status = values.isel(kept), status.isel(kept)
    across, up = (GridAxis.of(values[dim].values) for dim in (x, y))
    figure, axes = _figure(len(up.centres))
    colours = ValueColours.of(values.values)
    marked, gaps = _draw(axes, values, status, across, up, colours)
    axes.set(**across.settings("x"), **up.settings("y"))
    axes.set(xlabel=_axis_label(cube, x), ylabel=_upright(_axis_label(cube, y)))
    for axis, of_axis in ((across, axes.xaxis), (up, axes.yaxis)):
        if axis.whole and not axis.named:
            of_axis.set_major_locator(MaxNLocator(integer=True))
    axes.minorticks_off()
    axes.tick_params(length=0 if across.named and up.named else 2)
    axes.spines[:].set_visible(False)
    unit = values.attrs.get("units", "1")
    label = f"{values.attrs.get('long_name', of)} [{unit}]"
    colours.bar(figure, axes, pad=0.01, label=_upright(label))
    marks_legend(figure, marked, NO_VALUE, [text_note(EMPTY)] if gaps else [])
    figure.suptitle(", ".join([of, *fixed]), fontsize="small")
    return figure


def _varies_by_design(cube: xr.Dataset, of: str) -> bool:
    """Whether both numbers of a design vary, so that n_subunit would leave most places empty."""
    return all(cube.sizes[dim] > 1 and dim in cube[of].dims for dim in ("n_stripe", "n_subunit"))


def _axes(variable: xr.DataArray, x: str | None, y: str | None) -> tuple[str, str]:
    """The two dimensions of the grid: those asked for, or those with more than one value.

    Raises:
        BadInput: if one does not exist, both are one, or it is not clear which are meant.
    """
    dims = [str(dim) for dim in variable.dims]
    for option, dim in (("x", x), ("y", y)):
        if dim is not None and dim not in dims:
            raise fault(option, unknown(dim, dims, f"dimension of {variable.name}"))
    free = [dim for dim in dims if variable.sizes[dim] > 1 and dim not in (x, y)]
    if x is None and y is None:
        # n_stripe, the first, goes up.
        x, y = (free[1], free[0]) if len(free) == 2 else (None, None)
    elif x is None or y is None:
        other = free[0] if len(free) == 1 else None
        x, y = x or other, y or other
    if x is None or y is None:
        among = ", ".join(free or dims)
        problem = f"{variable.name} varies along {among}; give x and y, and select one value of"
        raise fault("grid", f"{problem} every other")
    if x == y:
        raise fault("y", f"is {y} as x is; choose another dimension")
    return x, y


def _plane(
    cube: xr.Dataset, x: str, y: str, of: str
) -> tuple[xr.DataArray, xr.DataArray, list[str]]:
    """Values and status over (y, x), and the value of every other dimension as text.

    Raises:
        BadInput: if another dimension has several values.
    """
    others = [str(dim) for dim in cube[of].dims if dim not in (x, y)]
    if several := [dim for dim in others if cube.sizes[dim] > 1]:
        unlabelled = [dim for dim in several if dim not in cube.coords]
        if unlabelled:
            raise fault(of, f"has several values along {', '.join(unlabelled)}; make these x and y")
        raise fault("grid", f"shows two dimensions; select {choices(cube, several)}")
    status = cube["status"]
    # A grid that shows no dimension of the designs shows one of them.
    plane = cube[[of]].isel(dict.fromkeys(others, 0))[of].transpose(y, x)
    flat = [dim for dim in design_dims(cube) if dim not in (x, y)]
    status = status.isel(dict.fromkeys(flat, 0)).broadcast_like(plane).transpose(y, x)
    fixed = [f"{dim} = {_text(cube[dim].values[0])}" for dim in others if dim in cube.coords]
    return plane, status, fixed


def _draw(
    axes: Axes,
    values: xr.DataArray,
    status: xr.DataArray,
    across: GridAxis,
    up: GridAxis,
    colours: ValueColours,
) -> tuple[set[Status], bool]:
    """Draw the cells, and return the statuses marked and whether there are empty places."""
    written = len(across.centres) <= MOST_COLUMNS and len(up.centres) <= MOST_ROWS
    marked: set[Status] = set()
    gaps = False
    line = 1.0 if written else 0.2
    for row, column in np.ndindex(values.shape):
        code, value = Status(int(status[row, column])), float(values[row, column])
        if code is Status.excluded:
            gaps = True
            continue
        left, right = across.edges[column : column + 2].tolist()
        low, high = up.edges[row : row + 2].tolist()
        place = Rectangle((left, low), right - left, high - low, lw=line)
        axes.add_patch(place)
        if code in (Status.ok, Status.not_converged) and np.isfinite(value):
            colour = colours(value)
            place.set(facecolor=colour, edgecolor="white" if written else colour)
            if written:
                middle = float(across.centres[column]), float(up.centres[row])
                look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6}
                axes.text(*middle, _text(value), color=ink_on(colour), **look)
        else:
            marked.add(code)
            place.set(**MARKS[code])
    return marked, gaps


def _figure(rows: int) -> tuple[Figure, Axes]:
    height = min(max(LOWEST, MARGIN + ROW * rows), HIGHEST)
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    return figure, figure.add_subplot()


def _upright(label: str) -> str:
    """A label in short lines."""
    return fill(label, LETTERS, break_long_words=False)


def _axis_label(cube: xr.Dataset, dim: str) -> str:
    if dim == PERIODS:
        return PERIODS_LABEL
    if dim in COORDINATES:
        known = COORDINATES[dim]
        unit = "" if known.units == "1" else f" [{known.units}]"
        name = "" if dim == "applied_strain" else f"{dim}: "
        return f"{name}{known.long_name}{unit}"
    unit = cube[dim].attrs.get("units", "1")
    return f"{dim} [{unit}]" if cube[dim].dtype.kind in "iuf" else dim


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else number(float(value), ".3g")


FIGURE = FigureKind(
    value_grid,
    dims=None,
    coordinates=("applied_strain", "stripe_parameter"),
    options=("x", "y", "of"),
)
