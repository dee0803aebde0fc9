"""Shards: a plan split among machines that do not talk to each other."""

import heapq
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from knitlab.io.errors import fault
from knitlab.simulation.case import Case
from knitlab.sweep.plan import Batch, Plan, batch_of

PARTS_OF_SHARE = 8
"""Parts that the work of a shard has at least, if its cases are small enough: batches are cut into
such parts, so that shards differ by less than one of them."""
DIGITS = 6
"""Digits of estimated times by which shards are balanced: the last digits of a float may differ
from machine to machine, and the split must not."""


@dataclass(frozen=True)
class Shard:
    """One of several parts of a plan.

    Attributes:
        number: its number, from 1 on.
        count: number of shards that the plan is split into.
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        """Refuse numbers that no shard has.

        Raises:
            BadInput: if the number is not one from 1 to the count.
        """
        whole = all(type(value) is int for value in (self.number, self.count))
        if not (whole and 1 <= self.number <= self.count):
            raise fault(
                f"shard {self.number}/{self.count}",
                "is not a part of a plan; give a whole number from 1 to the number of shards",
            )

    @classmethod
    def of(cls, text: str) -> "Shard":
        """Read a shard, as in ``3/40``.

        Raises:
            BadInput: if the text is of another form.
        """
        if not (match := re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text)):
            raise fault(f"shard {text}", "is not of the form NUMBER/COUNT; write it as in 3/40")
        return cls(int(match[1]), int(match[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def part_of(plan: Plan, shard: Shard) -> Plan:
    """The part of a plan that one shard simulates; without cases if there are more shards."""
    batches = split(plan.batches, plan.cases, shard.count)[shard.number - 1]
    own = {case_id for batch in batches for case_id in batch.cases}
    cases = {case_id: case for case_id, case in plan.cases.items() if case_id in own}
    return replace(plan, cases=cases, batches=batches)


def split(
    batches: Sequence[Batch], cases: Mapping[str, Case], count: int
) -> list[tuple[Batch, ...]]:
    """Split the batches of a plan among shards.

    Every case is in exactly one shard. The split depends on the plan alone, whatever is done
    already. The longest part goes first, each to the shard that has least to do, so that shards
    differ in estimated time by at most one part: about an eighth of a shard, or one case.

    Args:
        batches: all batches of the plan.
        cases: its cases, by identifier.
        count: number of shards.

    Returns:
        The batches of each shard.
    """
    share = math.fsum(batch.estimated_seconds for batch in batches) / count
    parts = [part for batch in batches for part in _parts(batch, cases, share / PARTS_OF_SHARE)]
    costs = {part: float(f"{part.estimated_seconds:.{DIGITS}g}") for part in parts}
    shards: list[list[Batch]] = [[] for _ in range(count)]
    loads = [(0.0, number) for number in range(count)]
    for part in sorted(parts, key=lambda part: (-costs[part], part.cases)):
        load, number = loads[0]
        heapq.heapreplace(loads, (load + costs[part], number))
        shards[number].append(part)
    return [tuple(its) for its in shards]


def _parts(batch: Batch, cases: Mapping[str, Case], longest: float) -> list[Batch]:
    """A batch, cut into parts that take at most a time, or into single cases."""
    # Rounded, because the number of parts must not depend on the last digit either.
    times = float(f"{batch.estimated_seconds / longest:.{DIGITS}g}") if longest else 1.0
    count = min(len(batch.cases), max(1, math.ceil(times)))
    if count == 1:
        return [batch]
    borders = [len(batch.cases) * k // count for k in range(count + 1)]
    return [batch_of(batch.cases[first:last], cases) for first, last in itertools.pairwise(borders)]
