"""A program read line by line: its operations, carriage passes and floats.

A pass is stitches of the same carriers in one direction, or transfers from one bed at one racking.
Between two passes in one direction the carriage comes back empty.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from knitlab.export.knitting.machine import Machine

DIRECTED = ("knit", "tuck")
OF_CARRIERS = ("in", "out", "inhook", "releasehook", "outhook")
NEEDLE = re.compile(r"([fb])(-?\d{1,9})")
KINDS = {"knit": "knit", "tuck": "knit", "xfer": "transfer", "drop": "drop"}
CARRIER_CHANGES = ("in", "out", "inhook", "outhook")


class Needle(NamedTuple):
    """A needle of the front or the back bed."""

    front: bool
    number: int

    def __str__(self) -> str:
        return f"{'f' if self.front else 'b'}{self.number}"


class Operation(NamedTuple):
    """An operation on a line of a program: its first word, the rest, and what these name."""

    line: int  # from 1
    opcode: str
    parameters: tuple[str, ...]
    direction: str | None = None  # of the carriage
    needles: tuple[Needle, ...] = ()
    carriers: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " ".join((self.opcode, *self.parameters))


def operations(text: str) -> Iterator[Operation]:
    """The operations of a program; comments are left out."""
    for line, content in enumerate(text.split("\n"), start=1):
        opcode, *words = content.partition(";")[0].split() or [""]
        if opcode in DIRECTED:
            direction = (*words, "")[0]
            carriers = tuple(words[2:])
            yield Operation(line, opcode, tuple(words), direction, _needles(words[1:2]), carriers)
        elif opcode in OF_CARRIERS:
            yield Operation(line, opcode, tuple(words), carriers=tuple(words))
        elif opcode:
            yield Operation(line, opcode, tuple(words), needles=_needles(words))


def _needles(words: Sequence[str]) -> tuple[Needle, ...]:
    return tuple(needle for needle in map(_needle, words) if needle is not None)


@lru_cache(10_000)  # a program names each needle in every course
def _needle(word: str) -> Needle | None:
    match = NEEDLE.fullmatch(word)
    return Needle(match[1] == "f", int(match[2])) if match else None


class CarriagePass(NamedTuple):
    """One movement of the carriage between two needles; direction + is rightwards, None either."""

    kind: str
    direction: str | None
    first: int
    last: int


class Duration(NamedTuple):
    """Numbers of passes of a program by what they do, and its time."""

    passes: dict[str, int]
    seconds: float


def carriage_passes(program: Iterable[Operation]) -> list[CarriagePass]:
    """The passes of a program, in order."""
    passes: list[CarriagePass] = []
    last: Operation | None = None  # of the pass so far
    for operation in program:
        if kind := KINDS.get(operation.opcode):
            number = operation.needles[0].number
            if last and _goes_on(last, operation):
                passes[-1] = passes[-1]._replace(last=number)
            else:
                passes.append(CarriagePass(kind, operation.direction, number, number))
            last = operation
        elif operation.opcode == "x-stitch-number" or not operation.opcode.startswith("x-"):
            last = None
    return passes


def _goes_on(before: Operation, following: Operation) -> bool:
    if KINDS[before.opcode] != KINDS[following.opcode] or before.direction != following.direction:
        return False
    if following.opcode in DIRECTED:
        return is_ahead(before, following) and before.carriers == following.carriers
    same_bed = before.needles[0].front == following.needles[0].front
    ahead = following.needles[0].number > before.needles[0].number
    return ahead and (following.opcode == "drop" or same_bed)


def is_ahead(before: Operation, following: Operation) -> bool:
    """Whether the carriage comes in one movement from a stitch to another."""
    step = following.needles[0].number - before.needles[0].number
    ahead = step > 0 if following.direction == "+" else step < 0
    return ahead and before.direction == following.direction


def duration(program: Iterable[Operation], machine: Machine) -> Duration:
    """Passes of a program, and its time by the speeds of the machine."""
    listed = list(program)
    passes = carriage_passes(listed)
    opcodes = Counter(operation.opcode for operation in listed)
    kinds = Counter(each.kind for each in passes)
    needles = Counter[str]()
    for each in passes:
        needles[each.kind] += abs(each.last - each.first) + 1
    returns = [
        abs(following.first - before.last)
        for before, following in pairwise(passes)
        if before.kind == following.kind == "knit" and before.direction == following.direction
    ]
    metres = machine.pitch / 1000
    seconds = (
        metres * (sum(returns) + needles["knit"] + needles["drop"]) / machine.knitting_speed
        + metres * needles["transfer"] / machine.transfer_speed
        + machine.turn_time * (len(passes) + len(returns))
        + machine.racking_time * opcodes["rack"]
        + machine.carrier_time * sum(opcodes[opcode] for opcode in CARRIER_CHANGES)
    )
    kinds["empty"] = len(returns)
    return Duration({kind: kinds[kind] for kind in ("knit", "transfer", "empty", "drop")}, seconds)


def longest_floats(program: Iterable[Operation]) -> dict[str, int]:
    """The most needles that the yarn of each carrier passes between two stitches in a row."""
    longest: dict[str, int] = {}
    last: dict[str, int] = {}
    for operation in program:
        for carrier in operation.carriers:
            if operation.opcode in DIRECTED:
                number = operation.needles[0].number
                passed = abs(number - last.get(carrier, number)) - 1
                longest[carrier] = max(longest.get(carrier, 0), passed)
                last[carrier] = number
            elif operation.opcode in CARRIER_CHANGES:
                last.pop(carrier, None)
    return longest
