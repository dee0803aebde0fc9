"""Queries: the designs of cubes as a table, filtered, sorted and printed."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cubes.condition import computed, holds, no_column
from knitlab.cubes.cube_file import cube_name, design_dims, model_options, source_path
from knitlab.cubes.derived import with_derived
from knitlab.cubes.model_line import model_line, model_lines
from knitlab.cubes.normalised import normalised
from knitlab.cubes.selection import refuse_others, select, selectable, selections_along
from knitlab.cubes.strain_window import with_columns
from knitlab.cubes.trust import COLUMN, legend, marks_of, with_marks_only
from knitlab.io.errors import Mistake, raise_if_any
from knitlab.io.names import as_texts
from knitlab.observables.of_cubes import STRIPES
from knitlab.observables.schema import FLAGS, INTEGERS, SIMULATION, SOURCE, STRAIN, VARIABLES
from knitlab.observables.status import Status

MAIN_COLUMNS = (
    *("applied_strain", "jumped", "poisson_ratio", "force_per_width", "poisson_ratio_min"),
    *("applied_strain_at_min", "intersections_at_min", "sensitivity", "working_range"),
    *("knit_cell_x", "knit_cell_y"),
)  # that the command line shows unless asked for others, after what tells rows apart
MAX_MAIN_COLUMNS = 8
ON_REQUEST = [name for name, each in VARIABLES.items() if each.group is STRIPES] + [COLUMN]
"""Columns that a table has only if they are asked for."""


@xr.register_dataset_accessor("knitlab")
class KnitlabAccessor:
    """Queries of an open cube, available as ``cube.knitlab``.

    Args:
        cube: a cube of results, see :func:`knitlab.open_cube`; xarray may have changed it.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        self._cube = with_derived(normalised(cube))

    @property
    def model(self) -> str:
        """The model that its numbers are of: lengths, contact, boundary and method."""
        return model_line(self._cube)

    def select(self, **selections: Any) -> xr.Dataset:
        """The cube at selected values of its coordinates; all dimensions are kept.

        Args:
            selections: a value or a list of values for each coordinate: ``n_stripe=[4, 6]``. A
                ``reaction_force`` [N] or ``force_per_width`` [N/mm] takes the place of the applied
                strain: the states of a test that controls the force; and a ``force_ratio`` that of
                ``load_ratio``, in biaxial tests.

        Returns:
            The slice of the cube.

        Raises:
            InputError: with every selection that does not exist in the cube.

        Example:
            >>> import knitlab as kl
            >>> cube = kl.open_cube("results/reference/periodic")
            >>> cube.knitlab.select(n_stripe=8).sizes["n_stripe"]
            1
        """
        return select(self._cube, selections)

    def query(
        self,
        where: str | None = None,
        *,
        sort: str | Sequence[str] | None = None,
        columns: str | Sequence[str] | None = None,
        **selections: Any,
    ) -> pd.DataFrame:
        """The designs of the cube as a table, one row for each.

        Variables along the applied strain appear once it is selected.

        Args:
            where: expression over the columns that the rows must meet.
            sort: column to sort by, or several; a leading minus sorts descending.
            columns: columns to keep, or expressions over them; by default all but the stripe
                parameters and ``marks``, the signs of what not to rely on.
            selections: a value or a list of values for each coordinate.

        Returns:
            The table, in the units of the cube's variables.

        Raises:
            InputError: with every mistake in these arguments.

        Example:
            >>> import knitlab as kl
            >>> cube = kl.open_cube("results/reference/periodic")
            >>> table = cube.knitlab.query("poisson_ratio < -0.8", applied_strain=0.15)
            >>> table[["n_stripe", "n_subunit"]].values.tolist()
            [[6, 36]]
        """
        return query_cubes([self._cube], selections, where, sort, columns)


def query_cubes(
    cubes: Sequence[xr.Dataset],
    selections: Mapping[str, Any] = {},
    where: str | None = None,
    sort: str | Sequence[str] | None = None,
    columns: str | Sequence[str] | None = None,
    marks: bool = False,
) -> pd.DataFrame:
    """The designs of cubes along the same dimensions as one table; see :func:`knitlab.query`.

    The attribute ``models`` has lines that state the models of the cubes.
    """
    keys = as_texts(sort or ())
    main = columns == "main"
    if isinstance(columns, str):
        # A comma within brackets belongs to a reduction such as mean(poisson_ratio, 0.05:0.25).
        columns = [] if main else re.findall(r"(?:\([^)]*\)?|[^,(])+", columns)
    listed = tuple(dict.fromkeys(name.strip() for name in columns or ()))
    asked = " ".join((where or "", *keys, *listed))
    known = with_columns(cubes, [where or "", *keys, *listed])
    table = designs_of_all(known, selections)
    if re.search(rf"\b{COLUMN}\b", asked):
        table[COLUMN] = marks_of_all(cubes, selections, listed or list(table.columns))
    table = queried(table, where, keys, listed)
    if main:
        sorted_by = " ".join((where or "", *keys))
        table = table[main_columns(table, re.findall(r"\w+", sorted_by))]
    if marks:
        of_rows = marks_of_all(cubes, selections, list(table.columns))
        table = with_marks(table, of_rows[table.index])
    table.attrs["models"] = model_lines(cubes)
    return table


def with_marks(table: pd.DataFrame, marks: Iterable[str]) -> pd.DataFrame:
    """The table with the marks of its rows as the last column, if there are any."""
    signs = list(marks)
    return table.assign(**{COLUMN: signs}) if any(signs) else table


def marks_of_all(
    cubes: Sequence[xr.Dataset], selections: Mapping[str, Any], columns: Sequence[str]
) -> pd.Series:
    """The marks of the rows of :func:`designs_of_all`, at the states that some columns show."""
    lean = [with_marks_only(cube) for cube in cubes]
    return designs_of_all(lean, selections, marked=columns)[COLUMN]


def designs_table(
    cube: xr.Dataset, selections: Mapping[str, Any] = {}, marked: Sequence[str] | None = None
) -> pd.DataFrame:
    """One row for each design and each selected value of further dimensions; none if excluded."""
    rows = [*design_dims(cube), *(name for name in selections if name not in design_dims(cube))]
    chosen = select(cube, selections)
    if marked is not None:
        marks = marks_of(chosen, marked, each_strain=STRAIN in rows)
        if STRAIN in rows:  # along which a measured cube may have no marks
            marks = marks.broadcast_like(chosen[STRAIN])
        chosen = chosen.assign({COLUMN: marks})
    shown = [name for name, each in chosen.data_vars.items() if set(each.dims) <= set(rows)]
    shown.sort(key=lambda name: name != "status")  # a file may have them in any order
    labels = {name: chosen[name] for name in rows if name in chosen.dims}  # of every row
    table = chosen[shown].assign_coords(labels).to_dataframe([*labels]).reset_index()
    table = table[table["status"] != Status.excluded].reset_index(drop=True)
    table.attrs["dims"] = {str(name): each.dims for name, each in cube.data_vars.items()}
    table.attrs["units"] = {
        str(name): unit
        for name, each in cube.variables.items()
        if (unit := each.attrs.get("units", "1")) != "1" and name not in FLAGS
    }
    table.attrs["words"] = {name: [flag.name for flag in flags] for name, flags in FLAGS.items()}
    for name in FLAGS.keys() & set(table):
        names = {flag.value: flag.name for flag in FLAGS[name]}
        table[name] = [names.get(code) for code in table[name]]
    for name in set(INTEGERS) & set(table) - set(FLAGS):
        table[name] = table[name].astype("Int64")
    return table


def designs_of_all(
    cubes: Sequence[xr.Dataset],
    selections: Mapping[str, Any] = {},
    marked: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The concatenated tables of cubes, each sliced along its own dimensions, with their source."""
    if len(cubes) == 1:
        return designs_table(cubes[0], selections, marked)
    known = {name: None for cube in cubes for name in selectable(cube)}
    hint = f"select along {', '.join(known)}"
    refuse_others(selections, known, f"is not a coordinate of these cubes; {hint}")
    tables = []
    for cube, name in zip(cubes, _distinct_names(cubes), strict=True):
        table = designs_table(cube, selections_along(selections, selectable(cube)), marked)
        source = table.pop(SOURCE) if SOURCE in table else SIMULATION
        origin = {SOURCE: source, "cube": name} | _differing_options(cube, cubes)
        for index, (column, value) in enumerate(origin.items(), start=len(design_dims(cube))):
            if column not in table:
                table.insert(index, column, value)
        tables.append(table)
    combined = pd.concat(tables, ignore_index=True)
    dims = {name: dims for each in tables for name, dims in each.attrs["dims"].items()}
    units = {name: unit for each in tables for name, unit in each.attrs["units"].items()}
    combined.attrs = tables[0].attrs | {"dims": dims, "units": units}
    return combined


def _distinct_names(cubes: Sequence[xr.Dataset]) -> list[str]:
    """Names of cubes, with as many parent folders as distinguish those of one name."""
    paths = [source_path(cube) or Path(cube_name(cube)) for cube in cubes]
    names = [path.name for path in paths]
    for name in set(names):
        alike = {path for path in paths if path.name == name and path.is_absolute()}
        if len(alike) > 1:
            shared = os.path.commonpath(path.parent for path in alike)
            names = [
                path.relative_to(shared).as_posix() if path in alike else own
                for own, path in zip(names, paths, strict=True)
            ]
    # Names that are still equal are of one cube given twice, or of cubes in memory.
    return [
        f"{name} ({names[: number + 1].count(name)})" if names.count(name) > 1 else name
        for number, name in enumerate(names)
    ]


def _differing_options(cube: xr.Dataset, cubes: Sequence[xr.Dataset]) -> dict[str, Any]:
    """The boundary of a cube, and its model options that differ from those of others."""
    options = [model_options(each) for each in cubes]
    names = sorted({name for each in options for name in each} - {"boundary"})
    differing = [name for name in names if len({each.get(name) for each in options}) > 1]
    return {name: model_options(cube).get(name) for name in ("boundary", *differing)}


def main_columns(table: pd.DataFrame, asked: Sequence[str] = ()) -> list[str]:
    """At most eight columns that answer most questions, and those that were ``asked`` for."""
    first = [str(name) for name in table.loc[:, :"status"]]
    varying = [name for name in first if name not in ("cube", SOURCE) or table[name].nunique() > 1]
    asked = [name for name in asked if name in table.columns]
    wanted = [*varying, *asked, *MAIN_COLUMNS]
    present = dict.fromkeys(name for name in wanted if name in table.columns)
    return list(present)[: max(MAX_MAIN_COLUMNS, len(varying) + len(asked))]


def queried(
    table: pd.DataFrame,
    where: str | None = None,
    sort: Sequence[str] = (),
    columns: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The rows for which a condition holds, sorted, with some columns, by default most."""
    names = [key.removeprefix("-") for key in sort]
    asked = [(f"columns {name}", name) for name in columns or ()]
    asked += [(f"sort {key}", key.removeprefix("-")) for key in sort]
    for source, name in asked:
        # An expression such as reaction_force / knit_cell_x.
        if name not in table.columns and not name.isidentifier():
            table = table.assign(**{name: computed(name, table, source)})
    missing = [each for each in asked if each[1] not in table.columns]
    raise_if_any([Mistake(source, no_column(name, table)) for source, name in missing])
    if where:
        table = table[holds(where, table)]
    if sort:
        ascending = [not key.startswith("-") for key in sort]
        table = table.sort_values(names, ascending=ascending, kind="stable")
    if columns:
        # Rows of several cubes must be told apart.
        cube = ["cube"] if "cube" in table and table["cube"].nunique() > 1 else []
        return table[list(dict.fromkeys([*cube, *columns]))]
    return table.drop(columns=ON_REQUEST, errors="ignore")


def variables_table(cubes: Sequence[xr.Dataset]) -> pd.DataFrame:
    """What can be asked for: every variable of cubes, with its dimensions, unit and meaning."""
    rows: dict[str, tuple[str, str, str]] = {}
    for cube in cubes:
        for name, each in cube.variables.items():
            along = ", ".join(str(dim) for dim in each.dims if dim not in design_dims(cube))
            about = each.attrs.get("long_name", "")
            rows.setdefault(str(name), (along or "-", each.attrs.get("units", "-"), about))
    table = [(name, *row) for name, row in sorted(rows.items())]
    return pd.DataFrame(table, columns=["name", "along", "unit", "meaning"])


def formatted(table: pd.DataFrame, style: str) -> str:
    """The table as text for people (``table``), or as ``csv`` or ``json`` for programs."""
    if style == "csv":
        return table.to_csv(index=False, lineterminator="\n").rstrip("\n")
    if style == "json":
        return table.to_json(orient="records", indent=1, double_precision=15)
    if table.empty:
        return "no design matches"
    units = {name: unit for name, unit in table.attrs.get("units", {}).items() if unit != "1"}
    headed = table.rename(columns=lambda name: f"{name} [{units[name]}]" if name in units else name)

    def significant(value: float) -> str:
        return f"{value:.4g}" if np.isfinite(value) else "-"

    shown = headed.to_string(index=False, float_format=significant, na_rep="-")
    return "\n".join([shown, *legend(table.get(COLUMN, ()))])
