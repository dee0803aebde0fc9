"""The verbs of the command line on an xarray Dataset: ``cube.knitlab.query(...)``."""

from collections.abc import Sequence

import pandas as pd
import xarray as xr

from knitlab.io.cube_file import open_cube
from knitlab.io.plain_cube import PlainCube
from knitlab.query.query import designs_table, queried
from knitlab.query.selection import selected

__all__ = ["KnitlabAccessor", "open_cube"]


@xr.register_dataset_accessor("knitlab")
class KnitlabAccessor:
    """What ``knitlab query`` does with a cube that is open."""

    def __init__(self, cube: xr.Dataset) -> None:
        self._cube = cube

    def select(self, *selections: str) -> xr.Dataset:
        """The cube at the coordinate values named, as ``"n_stripe=4,6"``; every dimension stays.

        Raises:
            BadInput: with every selection at fault.
        """
        return selected(self._cube, selections)

    def query(
        self,
        *selections: str,
        where: str | None = None,
        sort: str | Sequence[str] | None = None,
        columns: Sequence[str] | None = None,
    ) -> pd.DataFrame:
        """Its designs as a table, a row each; the arguments are those of ``knitlab query``.

        Args:
            selections: texts ``NAME=VALUE``.
            where: expression over the columns, such as ``"poisson_ratio_min < -0.3"``.
            sort: column to sort by, or several; a leading minus sorts descending.
            columns: columns to keep, by default all but the stripe numbers.

        Raises:
            BadInput: with every fault of these.
        """
        return queried(designs_table(PlainCube.of(self._cube), selections), where, sort, columns)
