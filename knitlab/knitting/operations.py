"""Operations: knitout read line by line."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple


class Needle(NamedTuple):
    """A needle.

    Attributes:
        front: whether it is on the front bed.
        number: its number.
    """

    front: bool
    number: int

    def __str__(self) -> str:
        return f"{'f' if self.front else 'b'}{self.number}"


@dataclass(frozen=True)
class Operation:
    """One operation of a program.

    Attributes:
        line: its line in the file, from 1.
        opcode: its first word.
        parameters: the words after that.
    """

    line: int
    opcode: str
    parameters: tuple[str, ...]

    @property
    def is_extension(self) -> bool:
        """Whether it is an extension of the language."""
        return self.opcode.startswith("x-")

    @property
    def direction(self) -> str | None:
        """Direction of the carriage, if it has one."""
        return self.parameters[0] if self.opcode in DIRECTED and self.parameters else None

    @property
    def needles(self) -> tuple[Needle, ...]:
        """The needles that it names."""
        found = (NEEDLE.fullmatch(word) for word in self.parameters)
        return tuple(Needle(match[1] == "f", int(match[2])) for match in found if match)

    @property
    def carriers(self) -> tuple[str, ...]:
        """The carriers that it names."""
        if self.opcode in CARRIER_ONLY:
            return self.parameters
        return self.parameters[2:] if self.opcode in DIRECTED else ()

    def __str__(self) -> str:
        return " ".join((self.opcode, *self.parameters))


NEEDLE = re.compile(r"([fb])(-?\d+)")
DIRECTED = ("knit", "tuck", "miss")
CARRIER_ONLY = ("in", "inhook", "releasehook", "out", "outhook")
TWO_NEEDLES = ("xfer",)
ONE_NEEDLE = ("drop",)
OTHERS = ("rack", "pause")
OPCODES = (*DIRECTED, *CARRIER_ONLY, *TWO_NEEDLES, *ONE_NEEDLE, *OTHERS)
"""The part of the language that knitlab reads; it writes all of them but miss, in, out and pause."""


def operations(text: str) -> Iterator[Operation]:
    """The operations of a program; comments are left out."""
    for line, content in enumerate(text.split("\n"), start=1):
        words = content.partition(";")[0].split()
        if words:
            yield Operation(line, words[0], tuple(words[1:]))


def headers(text: str) -> dict[str, str]:
    """The headers of a program, by name."""
    found: dict[str, str] = {}
    for content in text.split("\n")[1:]:
        if not content.startswith(";;"):
            break
        name, _, value = content[2:].partition(":")
        found[name.strip()] = value.strip()
    return found
