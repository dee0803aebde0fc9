"""Cube files: opening, writing and joining cubes, their dimensions and common settings."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from pydantic import BaseModel

from knitlab.cubes.case_file import UNREADABLE
from knitlab.cubes.derived import with_derived
from knitlab.cubes.normalised import ATTRIBUTE, NoCube, normalised
from knitlab.io.atomic_write import atomic_write
from knitlab.io.checksum import append_checksum, has_checksum
from knitlab.io.cube_path import CUBE, cube_path, no_cube
from knitlab.io.errors import InputError, Mistake, failed_import, invalid, shown
from knitlab.io.lock import is_locked
from knitlab.io.toml import json_table
from knitlab.observables import schema
from knitlab.observables.of_cubes import DERIVED, LABORATORY
from knitlab.observables.schema import DESIGN_DIMS, SIMULATION, SOURCE, VARIABLES

CHUNK_CACHE = 4_000_000  # bytes of a variable that HDF5 keeps uncompressed
GAUGE = "gauge_"  # prefix of the attributes of a cube that are its gauge [mm]
OPTION = "model_"  # prefix of the attributes of a cube that are model options


class CommonSettings(BaseModel):
    """What is read of the settings of a cube."""

    unit_cells: tuple[int, int] = (1, 1)
    sheet: dict[str, float] = {}
    solver: dict[str, Any] | None = None
    dynamics: dict[str, Any] | None = None


class Damaged(InputError):
    """A cube that is not as it was written."""


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

    Other programs may have written it: see :func:`knitlab.cubes.normalised.normalised`.

    Args:
        path: a ``cube.nc``, or the results folder that holds one.
        lazily: whether each variable is read only when it is used.

    Raises:
        InputError: if there is no such file, it is damaged, or it lacks what tables need.
        ImportError: if a library that reads it cannot be imported.
    """
    return with_derived(read_cube(path, lazily=lazily))


def read_cube(path: str | Path, *, lazily: bool = False) -> xr.Dataset:
    """The variables in the file of a cube, in the order of the schema, as :func:`open_cube`."""
    given, path = path, cube_path(path)
    try:
        try:
            complete = has_checksum(path)
        except ValueError as error:
            _check_unlocked(path)
            raise _damaged(path, error) from error
        cube = opened = _opened(path)
        # One without a checksum may be damaged anywhere.
        if not (lazily and complete):
            with cube:
                cube.load()
    except FileNotFoundError as error:
        raise no_cube(given) from error
    except InputError:
        raise
    except (ImportError, *UNREADABLE) as error:
        if library := failed_import(error):
            message = f"{library} cannot be imported ({error}); install it again"
            raise ImportError(message) from error
        from_system = isinstance(error, OSError) and (error.errno or 0) > 0  # not from netCDF
        if from_system or isinstance(error, UnicodeError):
            why = getattr(error, "strerror", error)
            raise invalid(str(path), f"cannot be read ({why}); check the path") from error
        if isinstance(error, OSError | RuntimeError):
            raise _damaged(path, error) from error
        message = f"cannot be read as a cube ({error}); give another cube.nc"
        raise NoCube([Mistake(str(path), message)]) from error
    cube = normalised(cube, str(path))
    if is_case(cube):
        raise invalid(str(path), "is a single case; give a cube.nc or a results folder")
    _check_gauge(cube, path)
    parameters_of(cube)
    cube.set_close(opened.close)
    return cube


def _damaged(path: Path, error: Exception) -> Damaged:
    message = f"is damaged, or no netCDF file ({error}); give another cube.nc, or run its workflow"
    hint = "again, which reads the designs whose case files are beside it"
    return Damaged([Mistake(str(path), f"{message} {hint}")])


def _check_gauge(cube: xr.Dataset, path: Path) -> None:
    for name, value in cube.attrs.items():
        is_length = isinstance(value, float | np.integer) and 0 < value < np.inf
        if str(name).startswith(GAUGE) and not is_length:
            message = f"has an attribute {name} that is not a length, {shown(value)}"
            raise NoCube([Mistake(str(path), f"{message}; remove it, or give another cube")])


def write_cube(cube: xr.Dataset, path: Path, sources: Iterable[xr.Dataset] = ()) -> xr.Dataset:
    """Write the file of a cube atomically; CannotWrite if that fails.

    Args:
        cube: a cube; one of dask is written block by block.
        path: where to write it; it may be the file of a source.
        sources: cubes that it is made from, whose files are closed.

    Returns:
        The cube, or one that reads the new file if it is one of dask.
    """
    import dask  # reading does not need it

    cube, encoding = schema.described(cube), schema.encoding(cube)
    with (
        atomic_write(path) as temporary,
        dask.config.set(scheduler="synchronous"),
        _small_chunk_cache(),
    ):
        try:
            cube.to_netcdf(temporary, engine="netcdf4", encoding=encoding)
        except (OSError, RuntimeError):  # by netCDF of HDF5, which does not say why
            # HDF5 locks a file that it writes, but not one in memory, where it sorts the variables.
            temporary.write_bytes(cube.to_netcdf(engine="netcdf4", encoding=encoding))
        append_checksum(temporary)
        for source in sources:
            source.close()  # Windows replaces no open file
    return read_cube(path, lazily=True) if cube.chunks else cube


@contextmanager
def _small_chunk_cache() -> Iterator[None]:
    """Have files that are opened keep a few blocks, and not 64 MB of each variable."""
    before = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(CHUNK_CACHE)
    try:
        yield
    finally:
        netCDF4.set_chunk_cache(*before)


def _opened(path: Path) -> xr.Dataset:
    """A netCDF file, opened; from its bytes where it cannot be locked."""
    try:
        with _small_chunk_cache():
            return xr.open_dataset(path, engine="netcdf4")
    except (OSError, RuntimeError):  # the second, at times, of a file that is open here
        _check_unlocked(path)
        with suppress(OSError, ValueError, RuntimeError):
            dataset = xr.open_dataset(path.read_bytes(), engine="netcdf4")
            dataset.encoding["source"] = str(path)
            return dataset
        raise


def _check_unlocked(path: Path) -> None:
    if is_locked(path):
        hint = "close it there, or set HDF5_USE_FILE_LOCKING=FALSE to read what is written so far"
        raise invalid(str(path), f"is opened for writing by another program; {hint}")


def known_variables(cube: xr.Dataset) -> xr.Dataset:
    """The variables of a simulated cube that a run stores, without those of other programs."""
    dims = design_dims(cube)

    def is_own(name: str) -> bool:
        known = VARIABLES.get(name)
        stored = known is not None and known.group not in (DERIVED, LABORATORY)
        return stored and {*cube[name].dims} == {*dims, *VARIABLES[name].dims}

    known = cube[[name for name in map(str, cube.data_vars) if is_own(name)]]
    known.set_close(cube.close)
    return known


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
    attributes = {str(name): value for name, value in cube.attrs.items()}
    named = [name for name in attributes if name.startswith(OPTION)]
    return {name.removeprefix(OPTION): attributes[name] for name in named}


def is_case(dataset: xr.Dataset) -> bool:
    """Whether a dataset holds a single case, without design dimensions."""
    return not dataset["status"].dims


def parameters_of(cube: xr.Dataset) -> dict[str, Any]:
    """The settings in the attributes of a cube or a case; InputError if they do not match."""
    where = f"{cube_name(cube) or 'cube'}: {ATTRIBUTE}"
    message = "is not a table as knitlab writes it; run its workflow again"
    return json_table(cube.attrs.get(ATTRIBUTE, "{}"), where, CommonSettings, message)


def cells_across(experiment: xr.Dataset) -> int:
    """Unit cells along the weft of a measured sample; InputError if it does not state them."""
    if not (cells := parameters_of(experiment).get("unit_cells")):
        message = f"has no unit_cells in its {ATTRIBUTE}; import its experiment again"
        raise invalid(cube_name(experiment), message)
    return int(cells[1])
