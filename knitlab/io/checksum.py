"""A file that ends with its own checksum, so that any damage is noticed when it is read.

netCDF ignores what follows its contents, and cuts it off when another program changes the file:
then the file has no checksum, and is believed as any file of another program.
"""

import hashlib
from os import SEEK_END
from pathlib import Path

from knitlab.io.text_file import plain_file

MARK = b"\nknitlab-sha256:"
LENGTH = len(MARK) + 2 * hashlib.sha256().digest_size
PART = 1 << 20  # bytes that are in memory at a time


def append_checksum(path: Path) -> None:
    """Append the checksum of a file to it."""
    with path.open("r+b") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        file.write(MARK + digest.encode())


def has_checksum(path: Path) -> bool:
    """Whether a file ends with its checksum; ValueError if that is of other contents."""
    with plain_file(path).open("rb") as file:
        left = max(file.seek(0, SEEK_END) - LENGTH, 0)
        file.seek(left)
        tail = file.read()
        if not tail.startswith(MARK):
            return False
        file.seek(0)
        digest = hashlib.sha256()
        while part := file.read(min(left, PART)):
            digest.update(part)
            left -= len(part)
    if tail[len(MARK) :] != digest.hexdigest().encode():
        raise ValueError("it has other contents than were written")
    return True
