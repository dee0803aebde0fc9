"""Queries: the designs of a cube as a table, filtered, sorted and printed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from knitlab.cube.design_status import Status
from knitlab.cube.expression import holds, no_column
from knitlab.cube.plain_cube import PlainCube
from knitlab.cube.reduced_columns import relabelled, with_columns
from knitlab.cube.schema import FLAGS, INTEGERS, SIMULATION, SOURCE, VARIABLES
from knitlab.cube.selection import chosen_places, refuse_others, selections_along
from knitlab.io.errors import BadInput, Fault

STRIPE_NUMBERS = [name for name, variable in VARIABLES.items() if variable.of == "stripes"]
"""Columns that are shown only on request."""


def designs_table(cube: PlainCube, selections: Mapping[str, Any] = {}) -> pd.DataFrame:
    """One row for each design, one column for each variable, without excluded combinations.

    Variables with further dimensions appear once all of these are selected, with a row for each
    selected value.

    Args:
        cube: the cube.
        selections: a value, or a sequence of values, by coordinate.

    Raises:
        BadInput: if a selection is wrong.
    """
    chosen = chosen_places(cube.coordinates, selections)
    rows = [*cube.design_dims, *(name for name in chosen if name not in cube.design_dims)]
    shown = [name for name, dims in cube.dims.items() if set(dims) <= set(rows)]
    along = [name for name in rows if any(name in cube.dims[variable] for variable in shown)]
    places = {name: chosen.get(name, range(len(cube.coordinates[name]))) for name in along}

    read = cube.read_several(shown)

    def sliced(name: str) -> np.ndarray:
        values = np.asarray(read[name])
        return values[np.ix_(*(places[dim] for dim in cube.dims[name]))] if values.ndim else values

    # A row for each existing design, at each value of the other dimensions.
    present = sliced("status") != Status.excluded
    others = [len(places[name]) for name in along[present.ndim :]]
    grid = np.broadcast_to(
        present.reshape(present.shape + (1,) * len(others)), (*present.shape, *others)
    )
    index = dict(zip(along, np.nonzero(grid), strict=True))
    columns = {name: cube.coordinates[name][list(places[name])][index[name]] for name in along}
    columns |= {name: sliced(name)[tuple(index[dim] for dim in cube.dims[name])] for name in shown}
    table = pd.DataFrame(columns)
    table.attrs["dims"] = cube.dims
    table.attrs["words"] = {name: [flag.name for flag in flags] for name, flags in FLAGS.items()}
    for name in FLAGS.keys() & set(table):
        names = {flag.value: flag.name for flag in FLAGS[name]}
        table[name] = [names.get(code) for code in table[name]]
    for name in set(INTEGERS) & set(table) - set(FLAGS):
        table[name] = table[name].astype("Int64")
    return table


def designs_of_all(cubes: Sequence[PlainCube], selections: Mapping[str, Any] = {}) -> pd.DataFrame:
    """The concatenated tables of several cubes, with the source of each row.

    A cube without a selected dimension, such as a simulation without cycles, is not sliced by it.

    Args:
        cubes: cubes of designs along the same dimensions.
        selections: see :func:`designs_table`.

    Raises:
        BadInput: if a selection is wrong.
    """
    if len(cubes) == 1:
        return designs_table(cubes[0], selections)
    known = {name for cube in cubes for name in cube.coordinates}
    remedy = f"select along {', '.join(known)}"
    refuse_others(selections, known, f"is not a coordinate of these cubes; {remedy}")
    tables = []
    for cube, cube_name in zip(cubes, _distinct_names(cubes), strict=True):
        table = designs_table(cube, selections_along(selections, cube.coordinates))
        source = table.pop(SOURCE) if SOURCE in table else SIMULATION
        origin: dict[str, Any] = {SOURCE: source, "cube": cube_name} | _differing_options(
            cube, cubes
        )
        for place, (name, value) in enumerate(origin.items(), start=len(cube.design_dims)):
            if name not in table:
                table.insert(place, name, value)
        tables.append(table)
    combined = pd.concat(tables, ignore_index=True)
    combined.attrs = tables[0].attrs
    combined.attrs["dims"] = {name: dims for cube in cubes for name, dims in cube.dims.items()}
    return combined


def _distinct_names(cubes: Sequence[PlainCube]) -> list[str]:
    """Names of cubes, with as many parent folders as distinguish those of one name."""
    names = [cube.name for cube in cubes]
    parts = [(cube.name,) if cube.path is None else cube.path.parts for cube in cubes]
    for depth in range(2, max(map(len, parts))):
        paths = {
            name: {path for other, path in zip(names, parts, strict=True) if other == name}
            for name in names
        }
        names = [
            "/".join(path[-depth:]) if len(paths[name]) > 1 else name
            for name, path in zip(names, parts, strict=True)
        ]
    # Names that are still equal are of one cube given twice, or of cubes in memory.
    return [
        f"{name} ({names[: place + 1].count(name)})" if names.count(name) > 1 else name
        for place, name in enumerate(names)
    ]


def _differing_options(cube: PlainCube, cubes: Sequence[PlainCube]) -> dict[str, Any]:
    """The boundary of a cube, and its model options that differ from those of others."""
    differing = {
        name
        for name in {name for other in cubes for name in other.options}
        if len({other.options.get(name) for other in cubes}) > 1
    }
    shown = sorted(differing | {"boundary"}, key=lambda name: (name != "boundary", name))
    return {name: cube.options.get(name) for name in shown}


def query_cubes(
    cubes: Sequence[PlainCube],
    selections: Mapping[str, Any] = {},
    where: str | None = None,
    sort: str | Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The designs of cubes as one table, filtered and sorted.

    Columns may be reductions over a window of strain, such as ``mean(poisson_ratio, 0.05:0.25)``.

    Args:
        cubes: cubes of designs along the same dimensions.
        selections: see :func:`designs_table`.
        where: see :func:`queried`.
        sort: see :func:`queried`.
        columns: see :func:`queried`.

    Raises:
        BadInput: with every fault of these arguments.
    """
    keys = [sort] if isinstance(sort, str) else list(sort or ())
    known = with_columns(cubes, [where or "", *keys, *(columns or ())])
    table = designs_of_all(known, selections)
    shown = None if columns is None else [relabelled(name) for name in columns]
    return queried(table, where, [relabelled(key) for key in keys], shown)


def queried(
    table: pd.DataFrame,
    where: str | None = None,
    sort: str | Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The rows for which an expression holds, sorted, with the requested columns.

    Args:
        table: a table of :func:`designs_table`.
        where: expression over its columns, see :func:`~knitlab.cube.expression.holds`.
        sort: column to sort by, or several, the first one first; a leading minus sorts descending.
        columns: columns to keep, by default all but the stripe numbers.

    Raises:
        BadInput: if the expression is at fault or a column does not exist.
    """
    faults = [
        Fault(f"columns {name}", no_column(name, table))
        for name in columns or ()
        if name not in table.columns
    ]
    keys = [sort] if isinstance(sort, str) else list(sort or ())
    names = [key.removeprefix("-") for key in keys]
    faults += [
        Fault(f"sort {key}", no_column(name, table))
        for key, name in zip(keys, names, strict=True)
        if name not in table.columns
    ]
    if faults:
        raise BadInput(faults)
    if where:
        table = table[holds(where, table)]
    if keys:
        ascending = [not key.startswith("-") for key in keys]
        table = table.sort_values(names, ascending=ascending, kind="stable")
    if columns:
        return table[list(dict.fromkeys(columns))]
    return table.drop(columns=[name for name in STRIPE_NUMBERS if name in table])


def formatted(table: pd.DataFrame, style: str) -> str:
    """The table as text for people (``table``), or as ``csv`` or ``json`` for programs."""
    if style == "csv":
        return table.to_csv(index=False).rstrip("\n")
    if style == "json":
        return table.to_json(orient="records", indent=1, double_precision=15)
    if table.empty:
        return "no design matches"
    return table.to_string(index=False, float_format=_significant, na_rep="-")


def _significant(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "-"
