"""A cube as plain arrays, without xarray, whose import takes longer than most queries."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np

from knitlab.cube.schema import DESIGN_DIMS, INTEGERS, MISSING, STRIPE_DIMS
from knitlab.io.errors import fault

if TYPE_CHECKING:
    import xarray as xr

CUBE = "cube.nc"
READING = "reading_"
"""Prefix of the attributes of a cube that state its model options."""


@dataclass(frozen=True)
class PlainCube:
    """A cube whose variables are read on request.

    Attributes:
        dims: dimensions of every variable that is not a coordinate.
        coordinates: values along every labelled dimension.
        read_several: returns the values of some variables by name; a file is opened once for all.
        name: name of its folder, or of its file.
        path: that folder or file, if there is one.
        options: the model options that all of its designs share.
    """

    dims: dict[str, tuple[str, ...]]
    coordinates: dict[str, np.ndarray]
    read_several: Callable[[Sequence[str]], dict[str, np.ndarray]]
    name: str
    path: Path | None
    options: dict[str, Any]

    @property
    def design_dims(self) -> tuple[str, ...]:
        """The dimensions of its designs, including those of swept settings."""
        return self.dims["status"]

    def read(self, name: str) -> np.ndarray:
        """The values of one variable."""
        return self.read_several([name])[name]

    @classmethod
    def of(cls, cube: "xr.Dataset") -> "PlainCube":
        """The plain form of an xarray cube."""
        return cls(
            {str(name): tuple(map(str, cube[name].dims)) for name in cube.data_vars},
            {str(name): cube[name].values for name in cube.coords if name in cube.dims},
            lambda names: {name: cube[name].values for name in names},
            str(cube.attrs.get("workflow", "")),
            named_path(Path(source)) if (source := cube.encoding.get("source")) else None,
            stated_options(cube.attrs),
        )


def open_plain_cube(path: str | Path) -> PlainCube:
    """Open a knitlab cube.

    Args:
        path: a ``cube.nc``, or the results folder that holds one.

    Raises:
        BadInput: if there is no such file, or it is not a cube.
    """
    path = cube_path(path)
    with read_as_cube(path), netCDF4.Dataset(path) as dataset:
        dims = {name: array.dimensions for name, array in dataset.variables.items()}
        coordinates = {name: dataset[name][...] for name in dims if dims[name] == (name,)}
        options = stated_options({name: dataset.getncattr(name) for name in dataset.ncattrs()})
    cube = PlainCube(
        {name: along for name, along in dims.items() if name not in coordinates},
        {name: np.ma.getdata(values) for name, values in coordinates.items()},
        lambda names: read_values(path, names),
        named_path(path).name,
        named_path(path),
        options,
    )
    check_is_cube(path, cube.dims.get("status") if "case_id" in cube.dims else None)
    return cube


def stated_options(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """The model options that the attributes of a cube state, by name."""
    return {
        str(name).removeprefix(READING): value
        for name, value in attributes.items()
        if str(name).startswith(READING)
    }


def named_path(path: Path) -> Path:
    """The folder that the file of a cube is named by, or the file if it has a name of its own."""
    return path.resolve().parent if path.name == CUBE else path.resolve()


def cube_path(path: str | Path) -> Path:
    """The file of a cube, given this file or its folder."""
    path = Path(path)
    return path / CUBE if path.is_dir() else path


@contextmanager
def read_as_cube(path: Path) -> Iterator[None]:
    """Explain why a file cannot be read as a cube.

    Raises:
        BadInput: if it does not exist, or is not netCDF.
    """
    try:
        yield
    except FileNotFoundError as error:
        raise fault(
            str(path), "does not exist; run a workflow or import an experiment first"
        ) from error
    except (OSError, ValueError) as error:
        raise fault(str(path), f"is not a netCDF file ({error}); give a cube.nc") from error


def read_values(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Values of some variables by name; missing ones are NaN."""
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_maskandscale(False)
        return {name: unmasked(name, dataset[name][...]) for name in names}


def unmasked(name: str, values: np.ndarray) -> np.ndarray:
    """Stored values of a variable, with NaN for missing integers."""
    return np.where(values == MISSING, np.nan, values) if name in INTEGERS else values


def check_is_cube(path: Path, dims: tuple[str, ...] | None) -> None:
    """Check that a file has design dimensions.

    Raises:
        BadInput: if it has none.
    """
    if dims is None or not base_of(dims):
        raise fault(
            str(path),
            f"is not a cube: it has no status along {' and '.join(DESIGN_DIMS)};"
            " give a cube.nc or a results folder",
        )


def base_of(dims: tuple[str, ...]) -> tuple[str, ...]:
    """The leading design dimensions of a checkerboard or of a pure stripe; empty if neither."""
    for known in (DESIGN_DIMS, STRIPE_DIMS):
        if dims[: len(known)] == known:
            return known
    return ()
