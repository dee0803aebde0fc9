"""Text files of any program: their encoding is recognised, and other files are named."""

import codecs
import math
from pathlib import Path

from knitlab.io.errors import InputError, invalid
from knitlab.io.limits import MAX_SIDE, MAX_STITCHES

BACKSLASH = """a backslash in "…" begins an escape; write the path in '…', or with /"""
UTF_32 = (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Marks of the order of bytes; that of UTF-16 begins that of UTF-32."""
BINARY = {
    b"PK\x03\x04": "is an Excel workbook or another archive, not text; export it as CSV",
    b"\xd0\xcf\x11\xe0": "is an old Excel workbook, not text; export it as CSV",
    b"\x89HDF": "is an HDF5 or netCDF file, not text; give a text file",
    b"CDF": "is a netCDF file, not text; give a text file",
    b"\x93NUMPY": "is a NumPy array, not text; give a text file",
    b"\x89PNG": "is a PNG image, not text; give a text file",
}
"""First bytes of files that are not text, and what to do instead."""
SPACES = dict.fromkeys(map(ord, "\u00a0\u2007\u2009\u202f\ufeff"), " ")
"""Spaces that programs write in place of a plain one."""


def read_text(path: Path, max_bytes: float = math.inf) -> str:
    """The text of a file in UTF-8, UTF-16, UTF-32 or Windows-1252, with plain spaces and LF.

    InputError if it cannot be read, is not text, or has more than ``max_bytes``.
    """
    try:
        if (size := path.stat().st_size) > max_bytes:
            raise invalid(str(path), f"has {size:,} bytes; give at most {max_bytes:,}")
        content = path.read_bytes()
    except OSError as error:
        raise cannot_be_read(path, error) from error
    for begin, message in BINARY.items():
        if content.startswith(begin):
            raise invalid(str(path), message)
    try:
        text = content.decode(_encoding(content))
    except UnicodeDecodeError as error:
        message = f"is not text in UTF-8, UTF-16 or Windows-1252 ({error.reason}); save it as UTF-8"
        raise invalid(str(path), message) from error
    if "\0" in text:
        raise invalid(str(path), "has zero bytes, so it is not text; export it as text in UTF-8")
    return text.translate(SPACES).replace("\r\n", "\n").replace("\r", "\n")


def check_grid(
    path: Path, rows: int, columns: int, what: str = "stitches", most: int = MAX_STITCHES
) -> None:
    """InputError if a file has too many rows and columns of stitches, pixels or characters."""
    if max(rows, columns) > MAX_SIDE or rows * columns > most:
        message = f"has {rows:,} rows of {columns:,} {what}; give at most {most:,} in all"
        raise invalid(str(path), f"{message} and {MAX_SIDE:,} along each side")


def cannot_be_read(path: Path, error: OSError) -> InputError:
    """The error that there is no file of this path, or none that can be read."""
    name, hint = str(path), "check the path"
    if not name.isprintable():  # as in TOML the escape in "data\\tensile.csv" is a tab
        name, hint = ascii(name), BACKSLASH
    return invalid(name, f"cannot be read ({error.strerror}); {hint}")


def _encoding(content: bytes) -> str:
    if content.startswith((*UTF_32, *UTF_16)):
        return "utf-32" if content.startswith(UTF_32) else "utf-16"
    # Without a mark, every other byte of Latin text in UTF-16 is zero.
    even, odd = any(content[:200:2]), any(content[1:200:2])
    if even != odd and len(content) > 1:
        return "utf-16-le" if even else "utf-16-be"
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"
