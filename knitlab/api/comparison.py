"""Tables of several cubes: queries, comparisons with experiments, the paper's claims."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from knitlab.cube.comparison import compared
from knitlab.cube.cube_file import open_cube
from knitlab.cube.query import query_cubes
from knitlab.cube.selection import refuse_others, selected, selections_along

Cube = str | Path | xr.Dataset
"""A cube, its file, or the results folder that holds it."""


def opened(cube: Cube) -> xr.Dataset:
    """A cube in memory.

    Raises:
        BadInput: if there is no such file, or it is not a cube.
    """
    return cube if isinstance(cube, xr.Dataset) else open_cube(cube)


def query(
    *cubes: Cube,
    where: str | None = None,
    sort: str | Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    **selections: Any,
) -> pd.DataFrame:
    """The designs of several cubes, simulated and measured, in one table.

    Args:
        cubes: cubes of designs along the same dimensions.
        where: expression over the columns that the rows must meet.
        sort: column to sort by, or several; a leading minus sorts descending.
        columns: columns to keep, by default all but the stripe parameters.
        selections: a value or a list of values for each coordinate.

    Raises:
        BadInput: with everything that is wrong in these arguments.

    Example:
        >>> import knitlab as kl
        >>> table = kl.query("results/reference/periodic", sort="poisson_ratio_min")
        >>> table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [8, 64]
    """
    return query_cubes([opened(cube) for cube in cubes], selections, where, sort, columns)


def compare(simulation: Cube, /, *experiments: Cube, **selections: Any) -> pd.DataFrame:
    """How far a simulation is from experiments, curve by curve.

    Args:
        simulation: a simulated cube.
        experiments: measured cubes, see :func:`knitlab.import_records`.
        selections: a value or a list of values for each coordinate.

    Returns:
        One row for each design, experiment and curve, with the RMS difference and its
        uncertainty, by the scatter of the records, in the unit of the curve.

    Raises:
        BadInput: if the cubes have no design in common, or a selection is at fault.
    """
    cubes = [opened(cube) for cube in (simulation, *experiments)]
    known = {str(name) for cube in cubes for name in cube.dims if name in cube.coords}
    remedy = f"select along {', '.join(sorted(known))}"
    refuse_others(selections, known, f"is not a coordinate of these cubes; {remedy}")
    chosen = [selected(cube, selections_along(selections, cube.dims)) for cube in cubes]
    return compared(chosen[0], chosen[1:])
