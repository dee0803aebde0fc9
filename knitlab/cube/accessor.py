"""Queries as methods of an xarray Dataset: ``cube.knitlab.query(...)``."""

from collections.abc import Sequence
from typing import Any

import pandas as pd
import xarray as xr

from knitlab.cube.plain_cube import PlainCube
from knitlab.cube.query import query_cubes
from knitlab.cube.selection import selected


class KnitlabAccessor:
    """Queries of an open cube, available as ``cube.knitlab``.

    Args:
        cube: a cube of results, see :func:`knitlab.open_cube`.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        self._cube = cube

    def select(self, **selections: Any) -> xr.Dataset:
        """The cube at selected values of its coordinates; all dimensions are kept.

        Args:
            selections: a value or a list of values for each coordinate: ``n_stripe=[4, 6]``.

        Returns:
            The slice of the cube.

        Raises:
            BadInput: with every selection that does not exist in the cube.

        Example:
            >>> import knitlab as kl
            >>> cube = kl.open_cube("results/reference/periodic")
            >>> cube.knitlab.select(n_stripe=8).sizes["n_stripe"]
            1
        """
        return selected(self._cube, selections)

    def query(
        self,
        where: str | None = None,
        *,
        sort: str | Sequence[str] | None = None,
        columns: Sequence[str] | None = None,
        **selections: Any,
    ) -> pd.DataFrame:
        """The designs of the cube as a table, one row for each.

        Variables along the applied strain appear once it is selected.

        Args:
            where: expression over the columns that the rows must meet.
            sort: column to sort by, or several; a leading minus sorts descending.
            columns: columns to keep, by default all but the stripe parameters.
            selections: a value or a list of values for each coordinate.

        Returns:
            The table, in the units of the cube's variables.

        Raises:
            BadInput: with every fault of these arguments.

        Example:
            >>> import knitlab as kl
            >>> cube = kl.open_cube("results/reference/periodic")
            >>> table = cube.knitlab.query("poisson_ratio < -0.6", applied_strain=0.15)
            >>> table[["n_stripe", "n_subunit"]].values.tolist()
            [[8, 48], [8, 64]]
        """
        return query_cubes([PlainCube.of(self._cube)], selections, where, sort, columns)
