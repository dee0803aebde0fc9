"""Cube files: opening, writing and joining cubes, and the dimensions of their designs."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cube import schema
from knitlab.cube.derived import with_derived
from knitlab.cube.schema import DESIGN_DIMS, SIMULATION, SOURCE, VARIABLES
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import fault
from knitlab.io.lock import is_locked

CUBE = "cube.nc"
OPTION = "model_"  # prefix of the attributes of a cube that are model options


def cube_path(path: str | Path) -> Path:
    """The file of a cube, given this file or its folder."""
    path = Path(path)
    return path / CUBE if path.is_dir() else path


def source_path(cube: xr.Dataset) -> Path | None:
    """The folder of a cube, or its file if that has a name of its own; None if it has no file."""
    if "source" not in cube.encoding:
        return None
    path = Path(cube.encoding["source"]).resolve()
    return path.parent if path.name == CUBE else path


def cube_name(cube: xr.Dataset) -> str:
    """Name of the folder of a cube, or of its file; of a cube without one, that of its workflow."""
    path = source_path(cube)
    return path.name if path else str(cube.attrs.get("workflow", ""))


def open_cube(path: str | Path, *, lazily: bool = False) -> xr.Dataset:
    """Read a knitlab cube into memory, with the variables that follow from its own.

    Args:
        path: a ``cube.nc``, or the results folder that holds one.
        lazily: whether each variable is read only when it is used.

    Raises:
        BadInput: if there is no such file, or it is not a cube.
    """
    return with_derived(read_cube(path, lazily=lazily))


def read_cube(path: str | Path, *, lazily: bool = False) -> xr.Dataset:
    """The variables in the file of a cube; otherwise as :func:`open_cube`.

    Dimensions are in the order of the schema and their numbers ascend, whoever wrote the file.
    """
    path = cube_path(path)
    try:
        cube = _opened(path)
        if not lazily:
            with cube:
                cube.load()
    except FileNotFoundError as error:
        problem = "does not exist; run a workflow or import an experiment first"
        raise fault(str(path), problem) from error
    except (OSError, ValueError, RuntimeError) as error:
        problem = f"is not a netCDF file, or a damaged one ({error}); give a cube.nc"
        raise fault(str(path), problem) from error
    if "status" in cube:
        cube = _in_order(cube)
    if not {"status", "case_id"} <= set(cube) or not base_dims(cube):
        raise fault(
            str(path),
            f"is not a cube: it has no status along {' and '.join(DESIGN_DIMS)};"
            " give a cube.nc or a results folder",
        )
    return cube


def _in_order(cube: xr.Dataset) -> xr.Dataset:
    """The cube with its dimensions in the order of the schema, and their numbers ascending.

    Labels of swept settings keep the order in which they were given.
    """
    dims = design_dims(cube)
    base = next((base for base in (DESIGN_DIMS, schema.STRIPE_DIMS) if {*base} <= {*dims}), ())
    order = dict.fromkeys((*base, *dims, *schema.COORDINATES))
    unsorted = [
        dim
        for dim, labels in cube.indexes.items()
        if dim in schema.COORDINATES
        and labels.dtype.kind in "fiu"
        and not labels.is_monotonic_increasing
    ]
    return cube.sortby(unsorted).transpose(*order, ..., missing_dims="ignore")


def write_cube(cube: xr.Dataset, path: Path) -> None:
    """Write the file of a cube atomically; CannotWrite if that fails."""
    cube, encoding = schema.described(cube), schema.encoding(cube)
    with atomic_write(path) as temporary:
        try:
            cube.to_netcdf(temporary, encoding=encoding)
        except (OSError, RuntimeError):  # by netCDF of HDF5, which does not say why
            # HDF5 locks a file that it writes, but not one in memory, where it sorts the variables.
            temporary.write_bytes(cube.to_netcdf(engine="netcdf4", encoding=encoding))


def _opened(path: Path) -> xr.Dataset:
    """A netCDF file, opened; from its bytes where it cannot be locked."""
    try:
        return xr.open_dataset(path, engine="netcdf4")
    except (OSError, RuntimeError) as error:  # the second, at times, of a file that is open here
        if is_locked(path):
            problem = "is opened for writing by another program; close it there, or set"
            remedy = f"{problem} HDF5_USE_FILE_LOCKING=FALSE to read what is written so far"
            raise fault(str(path), remedy) from error
        with suppress(OSError, ValueError, RuntimeError):
            dataset = xr.open_dataset(path.read_bytes(), engine="netcdf4")
            dataset.encoding["source"] = str(path)
            return dataset
        raise


def design_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The design dimensions of a cube, including those of swept settings."""
    return tuple(map(str, cube["status"].dims))


def base_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The design dimensions without swept settings; empty if it is no cube of fabrics."""
    dims = design_dims(cube)
    known = (base for base in (DESIGN_DIMS, schema.STRIPE_DIMS) if dims[: len(base)] == base)
    return next(known, ())


def swept_dims(cube: xr.Dataset) -> tuple[str, ...]:
    """The dimensions of settings that the workflow gives as lists."""
    return design_dims(cube)[len(base_dims(cube)) :]


def source_of(cube: xr.Dataset) -> str:
    """Source of a cube: ``simulation``, or the name of an experiment."""
    return str(cube[SOURCE].item()) if SOURCE in cube.coords else SIMULATION


def is_measured(cube: xr.Dataset) -> bool:
    """Whether a cube holds an experiment."""
    return source_of(cube) != SIMULATION


def model_options(cube: xr.Dataset) -> dict[str, Any]:
    """The model options that all designs of a cube share, by name."""
    stated = {str(name): value for name, value in cube.attrs.items()}
    names = [name for name in stated if name.startswith(OPTION)]
    return {name.removeprefix(OPTION): stated[name] for name in names}


def is_case(dataset: xr.Dataset) -> bool:
    """Whether a dataset holds a single case, without design dimensions."""
    return not dataset["status"].dims


def as_cube(case: xr.Dataset) -> xr.Dataset:
    """A single case as a cube of one design, without the variables that only case files have."""
    dims = [str(name) for name, each in case.coords.items() if not each.dims]
    names = [name for name in case.data_vars if VARIABLES[str(name)].in_cube]
    return case[names].expand_dims(dims)
