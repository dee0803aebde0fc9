"""Files in netCDF's classic format, in which small datasets are written and read ten times as fast.

A case has some fifty small variables. In the format of HDF5 each costs more than its numbers, in
time and in space; in the classic format a case file is also smaller, though not compressed.
"""

from collections.abc import Container
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.io.schema import INTEGERS, MISSING

if TYPE_CHECKING:
    import xarray as xr

MAGIC = b"CDF"
"""How a classic file begins."""
VERSION = 2
"""Of the classic format: with 64-bit offsets, so that a file may exceed 2 GB."""
ENCODING = "utf-8"
TEXT = "_Encoding"
"""Attribute that marks characters as text, for xarray and netCDF."""


def classic_bytes(dataset: "xr.Dataset") -> bytes:
    """Contents of the classic file of a dataset.

    Args:
        dataset: floats, integers, flags and texts; missing values of integers are NaN.
    """
    from scipy.io import netcdf_file  # queries and finished runs import this module without it

    buffer = _Buffer()
    file = netcdf_file(buffer, "w", version=VERSION)
    for name, size in dataset.sizes.items():
        file.createDimension(name, size)
    for name, variable in dataset.variables.items():
        values, attributes = _stored(str(name), variable.values), dict(variable.attrs)
        dims = tuple(map(str, variable.dims))
        if values.dtype.kind == "S":
            length = values.dtype.itemsize
            dims, attributes = (*dims, f"string{length}"), attributes | {TEXT: ENCODING}
            if dims[-1] not in file.dimensions:
                file.createDimension(dims[-1], length)
            values = values.reshape(*values.shape, 1).view("S1")
        if str(name) in INTEGERS:
            attributes["_FillValue"] = MISSING
        stored = file.createVariable(name, values.dtype, dims)
        stored[...] = values
        for key, value in attributes.items():
            numbers = not isinstance(value, str)
            setattr(stored, key, np.asarray(value, values.dtype) if numbers else value.encode())
    for key, value in dataset.attrs.items():
        setattr(file, str(key), value.encode() if isinstance(value, str) else value)
    file.close()
    return buffer.contents


class _Buffer(BytesIO):
    """A buffer whose contents outlive it: a netCDF file closes its buffer with itself."""

    contents = b""

    def close(self) -> None:
        if not self.closed:
            self.contents = self.getvalue()
        super().close()


def _stored(name: str, values: np.ndarray) -> np.ndarray:
    """Values of a type that the format has."""
    if values.dtype.kind in "OU":
        return np.char.encode(values.astype("U"), ENCODING).astype("S")
    if name in INTEGERS:
        return np.where(np.isnan(values), MISSING, values).astype(np.int32)
    if values.dtype.kind in "iub" and values.dtype.itemsize != 1:
        return values.astype(np.int32)
    return values


def read_classic(path: Path, names: Container[str]) -> dict[str, Any] | None:
    """Stored values of some variables of a classic file, or None if it is in another format.

    Numbers are as stored, in arrays; a single text is a ``str``.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is damaged.
    """
    contents = path.read_bytes()
    if not contents.startswith(MAGIC):
        return None
    from scipy.io import netcdf_file

    file: Any = netcdf_file(BytesIO(contents), "r", mmap=False)
    return {
        name: _native(np.asarray(each.data))
        for name, each in file.variables.items()
        if name in names
    }


def _native(values: np.ndarray) -> Any:
    """Values in this machine's byte order; characters as text."""
    if values.dtype.kind == "S":
        texts = np.char.decode(values.view(f"S{values.shape[-1]}")[..., 0], ENCODING)
        return texts if texts.ndim else texts.item()
    return values.astype(values.dtype.newbyteorder("="))
