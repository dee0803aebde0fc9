"""Queries: the designs of a cube as a table, filtered, sorted and printed."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.maps.expression import holds, no_column
from knitlab.maps.selection import selected
from knitlab.sweep.cube_file import design_dims
from knitlab.sweep.faults import BadInput, Fault
from knitlab.sweep.registry import Status


def designs_table(cube: xr.Dataset, selections: Sequence[str] = ()) -> pd.DataFrame:
    """One row a design, one column a variable; excluded combinations are left out.

    Variables along other dimensions appear once all of those are selected, with a row for each
    of the values that were chosen.

    Args:
        cube: the cube.
        selections: texts ``NAME=VALUE``, see :func:`~knitlab.maps.selection.selected`.

    Raises:
        BadInput: if a selection is at fault.
    """
    cube = selected(cube, selections)
    named = [text.partition("=")[0].strip() for text in selections]
    designs = design_dims(cube)
    rows = [*designs, *(name for name in dict.fromkeys(named) if name not in designs)]
    shown = [name for name in cube.data_vars if set(cube[name].dims) <= set(rows)]
    slices = cube[shown]
    order = [name for name in rows if name in slices.dims]
    present = cube["status"] != Status.excluded
    table = slices.where(present).to_dataframe(dim_order=order).reset_index()
    table = table[table["status"].notna()].reset_index(drop=True)
    table.attrs["dims"] = {str(name): cube[name].dims for name in cube.data_vars}
    table["status"] = [Status(int(code)).name for code in table["status"]]
    for name in ("periods", "iterations"):
        if name in table:
            table[name] = table[name].astype("Int64")
    return table


def queried(
    table: pd.DataFrame,
    where: str | None = None,
    sort: str | None = None,
    columns: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The rows for which an expression holds, sorted, and the columns that were asked for.

    Args:
        table: of :func:`designs_table`.
        where: expression over its columns, see :func:`~knitlab.maps.expression.holds`.
        sort: column to sort by; a leading minus sorts descending.
        columns: columns to keep, by default all.

    Raises:
        BadInput: if the expression is at fault or a column is not there.
    """
    faults = [
        Fault(f"--columns {name}", no_column(name, table))
        for name in columns or ()
        if name not in table.columns
    ]
    key = (sort or "").removeprefix("-")
    if sort and key not in table.columns:
        faults.append(Fault(f"--sort {sort}", no_column(key, table)))
    if faults:
        raise BadInput(faults)
    if where:
        table = table[holds(where, table)]
    if sort:
        table = table.sort_values(key, ascending=not sort.startswith("-"), kind="stable")
    return table[list(dict.fromkeys(columns))] if columns else table


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
