"""Files in netCDF's classic format, in which small datasets are written and read many times faster.

A case has some fifty small variables. In the format of HDF5 each costs more than its numbers, in
time and in space; in the classic format a case file is also smaller, though not compressed. The
libraries for it spend their time on the attributes, which are the same in every file: here they are
encoded once, and passed over when numbers are read. Any program that knows netCDF reads the files.

The format is that of https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html
with 64-bit offsets: lists of dimensions, attributes and variables as big-endian numbers and padded
names, then the values of each variable.
"""

import math
import struct
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.io.schema import INTEGERS, MISSING

if TYPE_CHECKING:
    import xarray as xr

MAGIC = b"CDF"
"""How a classic file begins."""
VERSION = b"\x02"
"""Of the format with 64-bit offsets, so that a file may exceed 2 GB."""
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12
"""Kinds of lists."""
TYPES = {1: ">i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8"}
"""NumPy's names of the format's types."""
TYPE_NUMBERS = {np.dtype(kind): number for number, kind in TYPES.items()}
SIZES = {number: np.dtype(kind).itemsize for number, kind in TYPES.items()}
NUMBER = struct.Struct(">I")
OFFSET = struct.Struct(">Q")
LARGEST = 2**32 - 1
"""Stated size of a variable that is too large for its field, which readers then ignore."""
ENCODING = "utf-8"
TEXT = "_Encoding"
"""Attribute that marks characters as text, for xarray and netCDF."""


def classic_bytes(dataset: "xr.Dataset") -> bytes:
    """Contents of the classic file of a dataset.

    Args:
        dataset: floats, integers, flags and texts; missing values of integers are NaN.
    """
    sizes = {str(name): size for name, size in dataset.sizes.items()}
    entries: list[bytes] = []
    stored: list[bytes] = []
    for key, variable in dataset.variables.items():
        name, values = str(key), _stored(str(key), variable.values)
        attributes, dims = dict(variable.attrs), tuple(map(str, variable.dims))
        kind = values.dtype.newbyteorder(">")
        if kind.kind == "S":
            length, kind = kind.itemsize, np.dtype("S1")
            dims, attributes = (*dims, f"string{length}"), attributes | {TEXT: ENCODING}
            sizes[dims[-1]] = length
        if name in INTEGERS:
            attributes["_FillValue"] = MISSING
        places = [list(sizes).index(dim) for dim in dims]
        stored.append(_padded(values.astype(kind if kind.kind != "S" else values.dtype).tobytes()))
        entries.append(
            _text(name)
            + _numbers(len(places), *places)
            + _attributes(attributes, kind)
            + _numbers(TYPE_NUMBERS[kind], min(len(stored[-1]), LARGEST))
        )
    dimensions = [_text(name) + _numbers(size) for name, size in sizes.items()]
    head = MAGIC + VERSION + _numbers(0) + _list(DIMENSIONS, dimensions)
    head += _attributes(dataset.attrs, np.dtype(">f8"))
    begin = len(head) + len(_list(VARIABLES, entries)) + OFFSET.size * len(entries)
    for k, contents in enumerate(stored):
        entries[k] += OFFSET.pack(begin)
        begin += len(contents)
    return head + _list(VARIABLES, entries) + b"".join(stored)


def _attributes(attributes: Mapping[Any, Any], kind: np.dtype) -> bytes:
    """The list of the attributes of a variable of a type; numbers have the same type."""
    numbers = TYPE_NUMBERS[kind] if kind.kind != "S" else TYPE_NUMBERS[np.dtype(">f8")]
    return _list(
        ATTRIBUTES,
        [
            _attribute(str(name), value if isinstance(value, str) else _tuple(value), numbers)
            for name, value in attributes.items()
        ],
    )


def _tuple(value: Any) -> tuple[float, ...]:
    return tuple(np.atleast_1d(value).tolist())


@lru_cache(maxsize=4096)
def _attribute(name: str, value: str | tuple[float, ...], numbers: int) -> bytes:
    if isinstance(value, str):
        text = value.encode()
        return _text(name) + _numbers(TYPE_NUMBERS[np.dtype("S1")], len(text)) + _padded(text)
    values = np.asarray(value, TYPES[numbers])
    return _text(name) + _numbers(numbers, len(values)) + _padded(values.tobytes())


def _list(kind: int, entries: Sequence[bytes]) -> bytes:
    return _numbers(kind if entries else 0, len(entries)) + b"".join(entries)


def _text(text: str) -> bytes:
    contents = text.encode()
    return _numbers(len(contents)) + _padded(contents)


def _numbers(*numbers: int) -> bytes:
    return b"".join(map(NUMBER.pack, numbers))


def _padded(contents: bytes) -> bytes:
    return contents + bytes(-len(contents) % 4)


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
        self._place += length + -length % 4
