"""Opening a cube, and which designs it holds."""

from pathlib import Path

import xarray as xr

from knitlab.sweep.faults import fault
from knitlab.sweep.registry import DESIGN_DIMS, STRIPE_DIMS


def open_cube(path: str | Path) -> xr.Dataset:
    """Read a knitlab cube into memory.

    Args:
        path: a ``cube.nc``, or the results folder that holds one.

    Raises:
        BadInput: if there is no such file, or it is not a cube.
    """
    path = Path(path)
    path = path / "cube.nc" if path.is_dir() else path
    try:
        with xr.open_dataset(path, engine="netcdf4") as dataset:
            cube = dataset.load()
    except FileNotFoundError as error:
        raise fault(str(path), "does not exist; run a workflow first") from error
    except (OSError, ValueError) as error:
        raise fault(str(path), f"is not a netCDF file ({error}); give a cube.nc") from error
    if "status" not in cube or design_dims(cube) not in (DESIGN_DIMS, STRIPE_DIMS):
        raise fault(
            str(path),
            f"is not a cube: it has no status along {' and '.join(DESIGN_DIMS)};"
            " give a cube.nc or a results folder",
        )
    return cube


def design_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The dimensions that the designs of a cube lie along."""
    return tuple(map(str, cube["status"].dims))
