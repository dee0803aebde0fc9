"""Cube files: how a cube is written, opened, and what its designs lie along. Needs no JAX."""

from pathlib import Path

import xarray as xr

from knitlab.sweep.faults import fault
from knitlab.sweep.files import written_whole
from knitlab.sweep.registry import DESIGN_DIMS, STRIPE_DIMS, encoding

CUBE = "cube.nc"


def open_cube(path: str | Path) -> xr.Dataset:
    """Read a knitlab cube into memory.

    Args:
        path: a ``cube.nc``, or the results folder that holds one.

    Raises:
        BadInput: if there is no such file, or it is not a cube.
    """
    path = Path(path)
    path = path / CUBE if path.is_dir() else path
    try:
        with xr.open_dataset(path, engine="netcdf4") as dataset:
            cube = dataset.load()
    except FileNotFoundError as error:
        raise fault(str(path), "does not exist; run a workflow first") from error
    except (OSError, ValueError) as error:
        raise fault(str(path), f"is not a netCDF file ({error}); give a cube.nc") from error
    if "status" not in cube or not base_dims(cube):
        raise fault(
            str(path),
            f"is not a cube: it has no status along {' and '.join(DESIGN_DIMS)};"
            " give a cube.nc or a results folder",
        )
    return cube


def write_cube(cube: xr.Dataset, path: Path) -> None:
    """Replace a cube's file whole, or leave the old one.

    Raises:
        CannotWrite: if it cannot be written.
    """
    with written_whole(path) as temporary:
        cube.to_netcdf(temporary, encoding=encoding(cube))


def design_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The dimensions that the designs of a cube lie along, those of swept settings included."""
    return tuple(map(str, cube["status"].dims))


def base_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """Those of a checkerboard or of a pure stripe; none if it is a cube of neither."""
    dims = design_dims(cube)
    for known in (DESIGN_DIMS, STRIPE_DIMS):
        if dims[: len(known)] == known:
            return known
    return ()


def swept_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """Those of settings that the workflow gave as lists."""
    return design_dims(cube)[len(base_dims(cube)) :]
