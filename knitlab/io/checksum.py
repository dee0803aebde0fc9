"""Files that end with their own checksum, so that any damage is noticed when they are read.

netCDF ignores what follows its contents. A file that another program changed has no checksum, and
is believed. In a table of JSON the checksum is the last entry.
"""

import hashlib
import re
from os import SEEK_END
from pathlib import Path

MARK = b"\nknitlab-sha256:"
LENGTH = len(MARK) + 2 * hashlib.sha256().digest_size
PART = 1 << 20  # bytes that are in memory at a time
END_OF_JSON = "\n}\n"
IN_JSON = re.compile(r',\n "sha256": "(\w+)"\n}\n\Z')


def append_checksum(path: Path) -> None:
    """Append the checksum of a file to it."""
    with path.open("r+b") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        file.write(MARK + digest.encode())


def has_checksum(path: Path) -> bool:
    """Whether a file ends with its checksum; ValueError if its contents differ."""
    with path.open("rb") as file:
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
        raise ValueError("its contents are not those that were written")
    return True


def json_with_checksum(text: str) -> str:
    """The text of a table that ends with its own checksum."""
    digest = hashlib.sha256(text.encode()).hexdigest()
    return f'{text.removesuffix(END_OF_JSON)},\n "sha256": "{digest}"{END_OF_JSON}'


def is_damaged_json(text: str) -> bool:
    """Whether the text of a table ends with the checksum of other contents."""
    if (stated := IN_JSON.search(text)) is None:
        return False
    contents = text[: stated.start()] + END_OF_JSON
    return hashlib.sha256(contents.encode()).hexdigest() != stated[1]
