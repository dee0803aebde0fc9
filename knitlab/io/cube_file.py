"""Cube files: how a cube is written, opened, and what its designs lie along."""

from pathlib import Path

import xarray as xr

from knitlab.io.atomic_write import atomic_write
from knitlab.io.plain_cube import base_of, check_is_cube, cube_path, read_as_cube
from knitlab.io.schema import SIMULATION, SOURCE, VARIABLES, encoding


def open_cube(path: str | Path) -> xr.Dataset:
    """Read a knitlab cube into memory.

    Args:
        path: a ``cube.nc``, or the results folder that holds one.

    Raises:
        BadInput: if there is no such file, or it is not a cube.
    """
    path = cube_path(path)
    with read_as_cube(path), xr.open_dataset(path, engine="netcdf4") as dataset:
        cube = dataset.load()
    check_is_cube(path, design_dims(cube) if {"status", "case_id"} <= set(cube) else None)
    return cube


def write_cube(cube: xr.Dataset, path: Path) -> None:
    """Replace a cube's file whole, or leave the old one.

    Raises:
        CannotWrite: if it cannot be written.
    """
    with atomic_write(path) as temporary:
        cube.to_netcdf(temporary, encoding=encoding(cube))


def design_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The dimensions that the designs of a cube lie along, those of swept settings included."""
    return tuple(map(str, cube["status"].dims))


def base_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """Those of a checkerboard or of a pure stripe."""
    return base_of(design_dims(cube))


def swept_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """Those of settings that the workflow gave as lists."""
    return design_dims(cube)[len(base_dims(cube)) :]


def source_of(cube: xr.Dataset) -> str:
    """What a cube is of: a simulation, or an experiment by its name."""
    return str(cube[SOURCE].item()) if SOURCE in cube.coords else SIMULATION


def is_measured(cube: xr.Dataset) -> bool:
    """Whether a cube is of an experiment."""
    return source_of(cube) != SIMULATION


def is_case(dataset: xr.Dataset) -> bool:
    """Whether a dataset is of a single case, with nothing along the dimensions of designs."""
    return not dataset["status"].dims


def as_cube(case: xr.Dataset) -> xr.Dataset:
    """A single case as a cube of one design, without what only case files hold."""
    dims = [str(name) for name, its in case.coords.items() if not its.dims]
    names = [name for name in case.data_vars if VARIABLES[str(name)].in_cube]
    return case[names].expand_dims(dims)
