"""Cube files: reading and writing cubes, and their dimensions."""

from pathlib import Path

import xarray as xr

from knitlab.cube.plain_cube import base_of, check_is_cube, cube_path, read_as_cube
from knitlab.cube.schema import SIMULATION, SOURCE, VARIABLES, encoding
from knitlab.io.atomic_write import atomic_write


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
    """Write the file of a cube atomically.

    Raises:
        CannotWrite: if it cannot be written.
    """
    with atomic_write(path) as temporary:
        cube.to_netcdf(temporary, encoding=encoding(cube))


def design_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The design dimensions of a cube, including those of swept settings."""
    return tuple(map(str, cube["status"].dims))


def base_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The design dimensions of a checkerboard or of a pure stripe, without swept settings."""
    return base_of(design_dims(cube))


def swept_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The dimensions of settings that the workflow gives as lists."""
    return design_dims(cube)[len(base_dims(cube)) :]


def source_of(cube: xr.Dataset) -> str:
    """Source of a cube: ``simulation``, or the name of an experiment."""
    return str(cube[SOURCE].item()) if SOURCE in cube.coords else SIMULATION


def is_measured(cube: xr.Dataset) -> bool:
    """Whether a cube holds an experiment."""
    return source_of(cube) != SIMULATION


def is_case(dataset: xr.Dataset) -> bool:
    """Whether a dataset holds a single case, without design dimensions."""
    return not dataset["status"].dims


def as_cube(case: xr.Dataset) -> xr.Dataset:
    """A single case as a cube of one design, without the variables that only case files have."""
    dims = [str(name) for name, each in case.coords.items() if not each.dims]
    names = [name for name in case.data_vars if VARIABLES[str(name)].in_cube]
    return case[names].expand_dims(dims)
