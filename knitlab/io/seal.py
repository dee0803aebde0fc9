"""Seals: a file that ends with its own checksum, so that any damage is noticed when it is read.

HDF5 ignores what follows its contents, and cuts it off when another program changes the file: then
the file has no seal, and is believed as any file of another program.
"""

import hashlib
from pathlib import Path

from knitlab.io.text_file import plain_file

MARK = b"\nknitlab-sha256:"
LENGTH = len(MARK) + 2 * hashlib.sha256().digest_size


def seal(path: Path) -> None:
    """Append the checksum of a file to it."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    with path.open("ab") as file:
        file.write(MARK + digest.encode())


def has_seal(path: Path) -> bool:
    """Whether a file has a seal; ValueError if its contents are others than were sealed."""
    contents = plain_file(path).read_bytes()
    own, tail = contents[:-LENGTH], contents[-LENGTH:]
    if not tail.startswith(MARK):
        return False
    if tail[len(MARK) :] != hashlib.sha256(own).hexdigest().encode():
        raise ValueError("it has other contents than were written")
    return True
