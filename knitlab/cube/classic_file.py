"""Case files in netCDF's classic format, by SciPy: many times faster than in that of HDF5.

A case has some fifty small variables. In the format of HDF5 each costs more than its numbers, in
time and in space; in the classic format a case file is also smaller, though not compressed.
"""

from collections.abc import Container
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.cube.schema import INTEGERS, MISSING

if TYPE_CHECKING:
    import xarray as xr

MAGIC = b"CDF"
"""How a classic file begins."""
LARGE_FILES = 2
"""Version of the format with 64-bit offsets, so that a file may exceed 2 GB."""
ENCODING = "utf-8"
TEXT = "_Encoding"
"""Attribute that marks characters as text, for xarray and netCDF."""


def classic_bytes(dataset: "xr.Dataset") -> bytes:
    """Contents of the classic file of a dataset.

    Args:
        dataset: floats, integers, flags and texts; missing values of integers are NaN.
    """
    from scipy.io import netcdf_file  # slow to import

    written = BytesIO()
    file = netcdf_file(written, "w", version=LARGE_FILES)
    for name, size in dataset.sizes.items():
        file.createDimension(str(name), size)
    for key, variable in dataset.variables.items():
        name, values, dims = str(key), _stored(str(key), variable.values), variable.dims
        attributes = dict(variable.attrs)
        if values.dtype.kind == "S":
            letters = f"string{values.dtype.itemsize}"
            if letters not in file.dimensions:
                file.createDimension(letters, values.dtype.itemsize)
            values, dims = values[..., None].view("S1"), (*dims, letters)
            attributes[TEXT] = ENCODING
        if name in INTEGERS:
            attributes["_FillValue"] = MISSING
        stored = file.createVariable(name, values.dtype, dims)
        stored.data[...] = values
        _describe(stored, attributes, values.dtype)
    _describe(file, dataset.attrs, np.dtype(float))
    file.flush()
    contents = written.getvalue()
    written.close()  # or the file would be written once more when it is collected
    return contents


def _describe(target: Any, attributes: dict[Any, Any], kind: np.dtype) -> None:
    """Attributes of a variable or of the file; numbers have the type of the variable."""
    for name, value in attributes.items():
        numbers = kind if kind.kind != "S" else float
        text = isinstance(value, str)
        setattr(target, str(name), value.encode() if text else np.asarray(value, numbers))


def _stored(name: str, values: np.ndarray) -> np.ndarray:
    """Values of a type that the format has."""
    if values.dtype.kind in "OU":
        return np.asarray(np.char.encode(values.astype("U"), ENCODING), "S")
    if name in INTEGERS:
        return np.where(np.isnan(values), MISSING, values).astype(np.int32)
    if values.dtype.kind in "iub" and values.dtype.itemsize != 1:
        return values.astype(np.int32)
    return values


def read_classic(path: Path, names: Container[str]) -> dict[str, Any] | None:
    """Stored values of some variables of a classic file, or None if it is in another format.

    Args:
        path: a file that :func:`classic_bytes` made.
        names: the variables to read, where the file has them.

    Returns:
        Numbers as stored, in arrays; a single text as a ``str``.

    Raises:
        OSError: if it cannot be read.
    """
    contents = path.read_bytes()
    if not contents.startswith(MAGIC):
        return None
    from scipy.io import netcdf_file  # slow to import

    file = netcdf_file(BytesIO(contents), "r", mmap=False)
    return {name: _read(its.data) for name, its in file.variables.items() if name in names}


def _read(stored: np.ndarray) -> Any:
    if stored.dtype.kind == "S":
        length = stored.shape[-1]
        texts = np.char.decode(
            np.ascontiguousarray(stored).view(f"S{max(length, 1)}")[..., 0], ENCODING
        )
        return texts if texts.ndim else texts.item()
    return stored.astype(stored.dtype.newbyteorder("="))
