"""Operations: knitout read line by line."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

DIRECTED = ("knit", "tuck")
OF_CARRIERS = ("inhook", "releasehook", "outhook")
NEEDLE = re.compile(r"([fb])(-?\d+)")


class Needle(NamedTuple):
    """A needle of the front or the back bed."""

    front: bool
    number: int

    def __str__(self) -> str:
        return f"{'f' if self.front else 'b'}{self.number}"


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation on a line of a program, from 1: its first word, and the words after that.

    ``direction`` of the carriage, ``needles`` and ``carriers`` are those that it names, if any.
    """

    line: int
    opcode: str
    parameters: tuple[str, ...]
    direction: str | None = None
    needles: tuple[Needle, ...] = ()
    carriers: tuple[str, ...] = ()

    @property
    def is_extension(self) -> bool:
        """Whether it is an extension of the language."""
        return self.opcode.startswith("x-")

    def __str__(self) -> str:
        return " ".join((self.opcode, *self.parameters))


def operations(text: str) -> Iterator[Operation]:
    """The operations of a program; comments are left out."""
    for line, content in enumerate(text.split("\n"), start=1):
        opcode, *words = content.partition(";")[0].split() or [""]
        if opcode in DIRECTED:
            direction, carriers = (*words, "")[0], tuple(words[2:])
            yield Operation(line, opcode, tuple(words), direction, _needles(words[1:2]), carriers)
        elif opcode in OF_CARRIERS:
            yield Operation(line, opcode, tuple(words), carriers=tuple(words))
        elif opcode:
            yield Operation(line, opcode, tuple(words), needles=_needles(words))


def _needles(words: Sequence[str]) -> tuple[Needle, ...]:
    matches = (NEEDLE.fullmatch(word) for word in words)
    return tuple(Needle(match[1] == "f", int(match[2])) for match in matches if match)


def headers(text: str) -> dict[str, str]:
    """The headers of a program, by name."""
    found: dict[str, str] = {}
    for content in text.split("\n")[1:]:
        if not content.startswith(";;"):
            break
        name, _, value = content[2:].partition(":")
        found[name.strip()] = value.strip()
    return found
