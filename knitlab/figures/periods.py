"""Designs by P, the periods of a stripe across a patch, in place of n_subunit."""

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import base_dims
from knitlab.cube.schema import DESIGN_DIMS, Status
from knitlab.figures.sources import missing_values

PERIODS = "periods"


def has_periods(cube: xr.Dataset) -> bool:
    """Whether the designs of a cube are checkerboards, which have P."""
    return base_dims(cube) == DESIGN_DIMS


def by_periods(cube: xr.Dataset) -> xr.Dataset:
    """A cube of checkerboards with the dimension ``periods`` in place of ``n_subunit``.

    P = n_subunit / (2 n_stripe), so that every n_stripe has designs at the same few P.

    Args:
        cube: the cube.
    """
    cube = cube.drop_vars(PERIODS, errors="ignore")
    of = {int(n): cube["n_subunit"].values / (2 * int(n)) for n in np.atleast_1d(cube["n_stripe"])}
    # P of what no n_stripe has as a design would be an empty column.
    planned = cube["status"] != Status.excluded
    used = planned.any([dim for dim in planned.dims if dim not in DESIGN_DIMS])
    wanted = sorted({float(p) for n in of for p in of[n][used.sel(n_stripe=n).values]})
    families = [
        cube.sel(n_stripe=[n])
        .assign_coords({PERIODS: ("n_subunit", of[n])})
        .swap_dims(n_subunit=PERIODS)
        .reindex({PERIODS: wanted}, fill_value=missing_values(cube))
        for n in of
    ]
    return xr.concat(families, "n_stripe", coords="different", compat="equals")
