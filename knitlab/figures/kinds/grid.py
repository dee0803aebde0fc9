"""Any variable of a cube over two of its dimensions."""

from functools import partial
from math import floor, log10
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cubes.cube_file import base_dims, design_dims
from knitlab.cubes.force_control import FORCES
from knitlab.cubes.selection import choices
from knitlab.cubes.strain_window import with_columns
from knitlab.figures import cells, style
from knitlab.figures.registry import figure
from knitlab.figures.style import Look, number, subplots
from knitlab.io.errors import invalid, unknown
from knitlab.observables.schema import COORDINATES, DESIGN_DIMS, FLAGS, STRAIN
from knitlab.observables.status import RUN, Status

PERIODS = "periods"
MAX_COLUMNS, MAX_ROWS = 16, 24  # of cells that still have room for a number
NO_VALUE = "no value there"
SLICED = (STRAIN, *FORCES, "stripe_parameter")


@figure(dims=None, coordinates=SLICED, options=("x", "y", "of"), compares=True)
def grid(
    cube: xr.Dataset, x: str | None = None, y: str | None = None, of: str = "poisson_ratio_min"
) -> Figure:
    """Any variable over any two dimensions of a cube, swept settings included.

    Either dimension may be ``periods`` for P = n_subunit / (2 n_stripe); without ``x`` and ``y``
    they are those with more than one value, with P in place of n_subunit.
    """
    cube = with_number(cube, of)
    has_periods = base_dims(cube) == DESIGN_DIMS
    # Along n_subunit most cells would be missing where both numbers of a design vary.
    both = has_periods and all(cube.sizes[n] > 1 and n in cube[of].dims for n in DESIGN_DIMS)
    if PERIODS in (x, y) or (x is y is None and both):
        if not has_periods:
            raise invalid("x" if x == PERIODS else "y", "pure stripes have no P; choose n")
        attributes, given = cube[of].attrs, of
        of = "P" if of == PERIODS else of
        cube = with_periods(cube.rename({given: of}))
        cube[of].attrs |= attributes
    x, y = _axes(cube[of], x, y)
    values, status, fixed = _plane(cube, x, y, of)
    used = status != Status.excluded
    if not used.any():
        raise invalid("grid", "no design of this selection was planned; choose others")
    kept = {dim: used.any(other).values for dim, other in ((x, y), (y, x))}
    values, status = values.isel(kept), status.isel(kept)
    figure, axes = subplots(min(max(2.4, 1.3 + 0.3 * len(values)), 6.5))
    colours = style.value_colours(values.values, style.is_signed(str(values.name)))
    large = values.shape[1] <= MAX_COLUMNS and values.shape[0] <= MAX_ROWS
    rgba = colours.to_rgba(values.values)
    # Three digits of the largest value, and as many decimals of all.
    largest = np.abs(values.values[np.isfinite(values.values)]).max(initial=0)
    form = f".{max(0, 2 - floor(log10(largest)))}f" if 1e-3 <= largest < 1e5 else ".3g"
    marked, look = set[Status](), Look()
    for row, column in np.ndindex(values.shape):
        code, value = Status(int(status[row, column])), float(values[row, column])
        if code in RUN and np.isfinite(value):
            look = {} if large else {"edgecolor": rgba[row, column], "linewidth": 0.2}
            look |= {"facecolor": rgba[row, column], "letters": {"fontsize": 6}}
            cells.cell(axes, row, column, number(value, form) if large else "", **look)
        else:
            marked.add(code)
            if code is not Status.excluded:
                look = {"linewidth": 1.0 if large else 0.2} | cells.MARKS[code]
                cells.cell(axes, row, column, **look)
    names = ([_text(each, "g") for each in values[dim].values] for dim in (x, y))
    cells.name_columns_and_rows(axes, *names)
    upright = partial(fill, width=26, break_long_words=False)
    axes.set(xlabel=_axis_label(cube, x), ylabel=upright(_axis_label(cube, y)))
    style.colour_bar(axes, colours, pad=0.01, label=upright(style.variable_label(values)))
    cells.marks_legend(figure, marked, NO_VALUE)
    figure.suptitle(", ".join([of, *fixed]), fontsize="small")
    return figure


def with_periods(cube: xr.Dataset) -> xr.Dataset:
    """A cube of checkerboards with the dimension ``periods`` in place of ``n_subunit``."""
    cube = cube.drop_vars(PERIODS, errors="ignore")
    planned = cube["status"] != Status.excluded
    planned = planned.any([dim for dim in planned.dims if dim not in DESIGN_DIMS])
    # P of what no n_stripe has as a design would be an empty column.
    designs = cube.stack(design=DESIGN_DIMS)
    designs = designs.isel(design=planned.stack(design=DESIGN_DIMS).values)
    n_stripe, n_subunit = (designs[dim].values for dim in DESIGN_DIMS)
    labels = [n_stripe, n_subunit / (2 * n_stripe)]
    index = pd.MultiIndex.from_arrays(labels, names=["n_stripe", PERIODS])
    coordinates = xr.Coordinates.from_pandas_multiindex(index, "design")
    designs = designs.drop_vars(["design", *DESIGN_DIMS]).assign_coords(coordinates)
    designs = designs.assign(n_subunit=("design", n_subunit))
    texts = {"status": Status.excluded, "case_id": "", "code": ""}
    missing = {str(name): texts.get(str(name), np.nan) for name in cube.data_vars}
    return designs.unstack("design", fill_value=missing)


def with_number(cube: xr.Dataset, of: str) -> xr.Dataset:
    """The cube with a variable, or the reduction of one, that must be a number."""
    (cube,) = with_columns([cube], [of])
    if of not in cube.data_vars:
        raise invalid("of", unknown(of, map(str, cube.data_vars), "variable"))
    if of in FLAGS or cube[of].dtype.kind not in "iuf":
        raise invalid("of", f"{of} is not a number; choose a variable with a unit")
    return cube


def _axes(variable: xr.DataArray, x: str | None, y: str | None) -> tuple[str, str]:
    dims = [str(dim) for dim in variable.dims]
    for option, dim in (("x", x), ("y", y)):
        if dim is not None and dim not in dims:
            raise invalid(option, unknown(dim, dims, f"dimension of {variable.name}"))
    free = [dim for dim in dims if variable.sizes[dim] > 1 and dim not in (x, y)]
    if len(free) < (count := (x is None) + (y is None)):  # others show their single value
        single = [dim for dim in dims if dim not in (x, y, *free)][: count - len(free)]
        free = [dim for dim in dims if dim in (*free, *single)]
    if len(free) == count:
        # n_stripe, the first, goes up.
        y = free.pop(0) if y is None else y
        x = free.pop(0) if x is None else x
    if x is None or y is None:
        among = ", ".join(free or dims)
        message = f"{variable.name} varies along {among}; give x and y, and select one value of"
        raise invalid("grid", f"{message} every other")
    if x == y:
        raise invalid("y", f"is {y} as x is; choose another dimension")
    return x, y


def _plane(
    cube: xr.Dataset, x: str, y: str, of: str
) -> tuple[xr.DataArray, xr.DataArray, list[str]]:
    """Values and status over (y, x), and the value of every other dimension as text."""
    others = [str(dim) for dim in cube[of].dims if dim not in (x, y)]
    if several := [dim for dim in others if cube.sizes[dim] > 1]:
        if unlabelled := [dim for dim in several if dim not in cube.coords]:
            raise invalid(of, f"varies along {', '.join(unlabelled)}; make these x and y")
        raise invalid("grid", f"shows two dimensions; select {choices(cube, several)}")
    plane = cube[of].isel(dict.fromkeys(others, 0)).transpose(y, x)
    # A grid that shows no dimension of the designs shows one of them.
    flat = [dim for dim in design_dims(cube) if dim not in (x, y)]
    status = cube["status"].isel(dict.fromkeys(flat, 0)).broadcast_like(plane).transpose(y, x)
    return plane, status, [_stated(cube[dim]) for dim in others if dim in cube.coords]


def _stated(coordinate: xr.DataArray) -> str:
    """The first value of a coordinate, with its name and unit."""
    unit = coordinate.attrs.get("units", "1")
    return f"{coordinate.name} = {_text(coordinate.values[0])}" + f" {unit}" * (unit != "1")


def _axis_label(cube: xr.Dataset, dim: str) -> str:
    if dim == PERIODS:
        return cells.PERIODS_LABEL
    if known := COORDINATES.get(dim):
        unit = "" if known.units == "1" else f" [{known.units}]"
        return f"{'' if dim == STRAIN else f'{dim}: '}{known.long_name}{unit}"
    unit = cube[dim].attrs.get("units", "1")
    return f"{dim} [{unit}]" if cube[dim].dtype.kind in "iuf" else dim


def _text(value: Any, form: str = ".3g") -> str:
    return value if isinstance(value, str) else number(float(value), form)
