"""Carriage passes of a program, and the time that a machine takes for them.

Operations that one movement of the carriage can do make one pass: stitches of the same carriers in
one direction, transfers from one bed at one racking. Groups of stitches of different carriers are
knitted in passes of their own (paper, "Knit capacitors"). Two passes in the same direction have an
empty one between them, in which the carriage comes back.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Literal

from knitlab.knitting.machine import Machine
from knitlab.knitting.operations import Operation

PassKind = Literal["knit", "transfer", "drop"]
KINDS: dict[str, PassKind] = {
    "knit": "knit",
    "tuck": "knit",
    "xfer": "transfer",
    "drop": "drop",
}
CARRIER_CHANGES = ("inhook", "outhook")


@dataclass(frozen=True)
class CarriagePass:
    """One movement of the carriage.

    Attributes:
        kind: what it does.
        direction: where it goes, + rightwards; none where it may go either way.
        carriers: carriers that it takes along.
        first, last: numbers of the needles at which it begins and ends to work.
        operations: how many operations it makes.
    """

    kind: PassKind
    direction: str | None
    carriers: tuple[str, ...]
    first: int
    last: int
    operations: int


@dataclass(frozen=True)
class Duration:
    """What a program takes.

    Attributes:
        knit_passes: passes with stitches.
        transfer_passes: passes with transfers.
        empty_passes: passes in which the carriage comes back.
        drop_passes: passes that drop loops.
        seconds: the estimated time [s].
    """

    knit_passes: int
    transfer_passes: int
    empty_passes: int
    drop_passes: int
    seconds: float

    @property
    def passes(self) -> int:
        """All passes."""
        return self.knit_passes + self.transfer_passes + self.empty_passes + self.drop_passes


def carriage_passes(program: Iterable[Operation]) -> Iterator[CarriagePass]:
    """The passes of a program, in order."""
    group: list[Operation] = []
    for operation in program:
        if operation.is_extension and operation.opcode != "x-stitch-number":
            continue
        if group and not (operation.opcode in KINDS and _joins(group, operation)):
            yield _pass_of(group)
            group = []
        if operation.opcode in KINDS:
            group.append(operation)
    if group:
        yield _pass_of(group)


def duration(program: Iterable[Operation], machine: Machine) -> Duration:
    """Passes of a program, and its time by the speeds of the machine.

    Args:
        program: its operations.
        machine: the machine.
    """
    listed = list(program)
    passes = list(carriage_passes(listed))
    time = machine.time
    count = {
        kind: len(list(group)) for kind, group in groupby(sorted(each.kind for each in passes))
    }
    returns = [
        abs(following.first - before.last)
        for before, following in pairwise(passes)
        if before.kind == following.kind == "knit" and before.direction == following.direction
    ]
    knitted = sum(returns) + sum(_width(each) for each in passes if each.kind != "transfer")
    transferred = sum(_width(each) for each in passes if each.kind == "transfer")
    metres = machine.pitch / 1000
    seconds = (
        metres * knitted / time.knitting_speed
        + metres * transferred / time.transfer_speed
        + time.turn_time * (len(passes) + len(returns))
        + time.racking_time * sum(each.opcode == "rack" for each in listed)
        + time.carrier_time * sum(each.opcode in CARRIER_CHANGES for each in listed)
    )
    return Duration(
        knit_passes=count.get("knit", 0),
        transfer_passes=count.get("transfer", 0),
        empty_passes=len(returns),
        drop_passes=count.get("drop", 0),
        seconds=seconds,
    )


def longest_floats(program: Iterable[Operation]) -> dict[str, int]:
    """The most needles that the yarn of each carrier passes within a pass or to its next one.

    Args:
        program: its operations.

    Returns:
        Needles between two stitches of a carrier that lie side by side in time, by carrier.
    """
    found: dict[str, int] = {}
    last: dict[str, int] = {}
    for operation in program:
        if operation.opcode in ("knit", "tuck"):
            number = operation.needles[0].number
            for carrier in operation.carriers:
                passed = abs(number - last.get(carrier, number)) - 1
                found[carrier] = max(found.get(carrier, 0), passed)
                last[carrier] = number
        elif operation.opcode in CARRIER_CHANGES:
            for carrier in operation.carriers:
                last.pop(carrier, None)
    return found


def _width(each: CarriagePass) -> int:
    return abs(each.last - each.first) + 1


def _joins(group: list[Operation], operation: Operation) -> bool:
    """Whether an operation goes on in the pass of those before it."""
    before = group[-1]
    if KINDS[before.opcode] != KINDS[operation.opcode]:
        return False
    number, following = before.needles[0].number, operation.needles[0].number
    if KINDS[operation.opcode] == "knit":
        onward = following > number if operation.direction == "+" else following < number
        same = (before.direction, before.carriers) == (operation.direction, operation.carriers)
        return same and onward
    same_bed = before.needles[0].front == operation.needles[0].front
    return following > number and (operation.opcode == "drop" or same_bed)


def _pass_of(group: list[Operation]) -> CarriagePass:
    first, last = group[0], group[-1]
    return CarriagePass(
        kind=KINDS[first.opcode],
        direction=first.direction,
        carriers=first.carriers,
        first=first.needles[0].number,
        last=last.needles[0].number,
        operations=len(group),
    )
