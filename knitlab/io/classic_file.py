"""Files in netCDF's classic format, in which small datasets are written and read ten times as fast.

A case has some fifty small variables. In the format of HDF5 each costs more than its numbers, in
time and in space; in the classic format a case file is also smaller, though not compressed.
"""

import math
import struct
from collections.abc import Callable, Container, Iterator
from functools import partial
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
TYPES = {1: ">i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
"""NumPy's names of the format's types."""
SIZES = {number: np.dtype(kind).itemsize for number, kind in TYPES.items()}
NUMBER = struct.Struct(">I")
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

    The attributes are passed over: to read them takes most of the time of a library.

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
    header = _Header(contents)
    return {name: values() for name, values in header.variables() if name in names}


class _Header:
    """The header of a classic file: lists of dimensions, attributes and variables, as numbers."""

    def __init__(self, contents: bytes) -> None:
        self._contents = contents
        self._place = len(MAGIC) + 1 + 4  # the version and the number of records

    def variables(self) -> Iterator[tuple[str, Callable[[], Any]]]:
        """Name of each variable, and a function that returns its values."""
        sizes = []
        for _ in range(self._listed()):
            self._name()
            sizes.append(self._number())
        self._skip_attributes()
        for _ in range(self._listed()):
            name = self._name()
            shape = tuple(sizes[self._number()] for _ in range(self._number()))
            self._skip_attributes()
            kind = TYPES[self._number()]
            self._number()  # its size
            high, low = self._number(), self._number()
            yield name, partial(self._values, np.dtype(kind), shape, (high << 32) + low)

    def _values(self, kind: np.dtype, shape: tuple[int, ...], begin: int) -> Any:
        values = np.frombuffer(self._contents, kind, math.prod(shape), begin).reshape(shape)
        if kind.kind == "S":
            texts = np.char.decode(values.view(f"S{shape[-1]}")[..., 0], ENCODING)
            return texts if texts.ndim else texts.item()
        return values.astype(kind.newbyteorder("="))

    def _number(self) -> int:
        (number,) = NUMBER.unpack_from(self._contents, self._place)
        self._place += 4
        return int(number)

    def _listed(self) -> int:
        """Length of a list, which follows its kind."""
        self._number()
        return self._number()

    def _name(self) -> str:
        length = self._number()
        name = self._contents[self._place : self._place + length]
        self._skip(length)
        return name.decode()

    def _skip_attributes(self) -> None:
        for _ in range(self._listed()):
            self._skip(self._number())
            size = SIZES[self._number()]
            self._skip(size * self._number())

    def _skip(self, length: int) -> None:
        """Pass over some bytes, and those that pad them to four."""
        self._place += -(-length // 4) * 4
