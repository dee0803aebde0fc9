"""Names that users give: one rule for all, and paths that are made of them."""

import re
import unicodedata
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from knitlab.io.errors import invalid, shown
from knitlab.io.limits import MAX_LINE, MAX_NAME

WINDOWS = r"(?i:con|prn|aux|nul|(com|lpt)\d)(\.|\Z)"  # devices, which cannot be files there
NAME = re.compile(rf"(?=.{{1,{MAX_NAME}}}\Z)(?!{WINDOWS})\w(?:[\w .-]*[\w-])?")
RULE = (
    f"is not a name of at most {MAX_NAME} letters, digits, '.', '_', '-' and spaces, which begins"
    " with a letter or a digit and is not the name of a Windows device, such as con; choose another"
    " name"
)
CONTROLS = {code: f"\\x{code:02x}" for code in {*range(32), *range(127, 160)} - {*b"\t"}}
CONTROLS |= {0x2028: "\\u2028", 0x2029: "\\u2029"}
"""Control characters and ends of lines, as they are shown."""


def one_line(text: object) -> str:
    """A text as a single line, whatever names it holds."""
    return str(text).translate(CONTROLS)


def as_texts(given: Iterable[str]) -> list[str]:
    """Several texts, or one, which Python would take letter by letter."""
    return [given] if isinstance(given, str) else [*given]


def is_name(text: str) -> bool:
    """Whether a text keeps the rule of names."""
    return NAME.fullmatch(unicodedata.normalize("NFC", text)) is not None


def _name(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"{shown(text)} {RULE}")
    return text


def _line(text: str) -> str:
    if not text.isprintable():
        raise ValueError(f"{shown(text)} has characters that cannot be printed; remove them")
    return text


Name = Annotated[str, AfterValidator(_name)]
"""A name of a user, which may become that of a folder or a label."""
Line = Annotated[str, Field(min_length=1, max_length=MAX_LINE), AfterValidator(_line)]
"""A line of text, as a title."""


def named_folder(folder: Path, name: str) -> Path:
    """The subfolder of a name that a user or a file gives; InputError if it is not a name."""
    if not is_name(name):
        raise invalid(repr(name), RULE)
    return folder / name


def inside(folder: Path, name: str) -> Path:
    """The file of a name in a folder; InputError if it would be elsewhere."""
    if name in ("", ".", "..") or {*name} & {*"/\\\0"}:
        raise invalid(str(folder), f"cannot hold a file named {name!r}; its name is damaged")
    return folder / name


def check_suffix(output: Path, known: Collection[str], kind: str) -> None:
    """InputError unless the suffix of a file to write is a known one of a kind, as "a mesh"."""
    if output.suffix.lower() not in known:
        message = f"has no suffix of {kind}; give one of {', '.join(known)}"
        raise invalid(f"file {output}", message)
