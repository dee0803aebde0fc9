"""Batches: cases simulated together, their time and memory, and shards of about equal time.

The numbers of the estimates are measurements that the page on performance states.
"""

import heapq
import itertools
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from knitlab.io import job_limits
from knitlab.io.errors import invalid
from knitlab.io.limits import MAX_CASES
from knitlab.solvers.case import Case, by_test
from knitlab.solvers.methods import METHODS

BATCH_UNKNOWNS = 8_000  # unknowns that one vmapped batch may hold: about 1 GiB of element Hessians
SECONDS_OF_CAPACITANCE = 0.6  # of electrodes that cover 100 grid cells, in one state
CAPACITANCE_POWER = 1.4  # of the number of these cells with which it grows
SECONDS_OF_STATE = 0.012  # at least, however small the fabric, to find and to measure it
PROCESS_BYTES = 500e6  # memory of a worker with its compiled programs
BATCHES_OF_SHARD = 8  # batches of each shard, at least, if their cases are small enough
DIGITS = 6  # of the estimated times that balance shards, whatever the machine


@dataclass(frozen=True)
class Batch:
    """Cases that one vmapped program simulates together, as identifiers; time on one core."""

    cases: tuple[str, ...]
    unknowns: int
    estimated_seconds: float
    estimated_bytes: float


@dataclass(frozen=True)
class Shard:
    """One of the ``count`` shares of a plan, numbered from 1 on."""

    number: int
    count: int

    def __post_init__(self) -> None:
        integers = all(type(value) is int for value in (self.number, self.count))
        if not (integers and 1 <= self.number <= self.count <= MAX_CASES):
            hint = f"give whole numbers from 1/1 to {MAX_CASES:,}/{MAX_CASES:,}"
            raise invalid(f"shard {self}", f"is not a part of a plan; {hint}")

    @classmethod
    def of(cls, text: str) -> "Shard":
        """Read a shard, as in ``3/40``; InputError if it is not."""
        if not (match := re.fullmatch(r"\s*(\d{1,9})\s*/\s*(\d{1,9})\s*", text)):
            raise invalid(f"shard {text}", "is not NUMBER/COUNT; write it as in 3/40")
        return cls(int(match[1]), int(match[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def batched(cases: Mapping[str, Case]) -> tuple[Batch, ...]:
    """Batches of cases that can be stacked, as large as memory allows, the longest first."""
    alike: dict[tuple[Any, ...], list[str]] = defaultdict(list)
    for case_id, case in cases.items():
        # Mass and damping are numbers of each fabric in a batch.
        dynamics = case.dynamics and replace(case.dynamics, damping_ratio=0.0, surface_density=1.0)
        options = case.options.fold_angle, case.options.contact
        kinds = tuple(stripe.spring_kind for stripe in case.stripes)
        key = case.mesh_shape, options, kinds, dynamics
        alike[key].append(case_id)
    batches = []
    for (shape, *_), members in alike.items():
        size = max(1, BATCH_UNKNOWNS // shape.unknowns)
        sharing = by_test((case_id, cases[case_id]) for case_id in members)
        for first in range(0, len(sharing), size):
            together = itertools.chain.from_iterable(sharing[first : first + size])
            batches.append(_batch_of(tuple(together), cases))
    return tuple(sorted(batches, key=lambda batch: batch.estimated_seconds, reverse=True))


def _batch_of(members: Sequence[str], cases: Mapping[str, Case]) -> Batch:
    """The batch of cases of one mesh shape; those that share a test cost as much as one."""
    sharing = by_test((case_id, cases[case_id]) for case_id in members)
    first = cases[members[0]]
    unknowns = first.mesh_shape.unknowns * len(sharing)
    time = seconds(cases[those[0]] for those in sharing)
    memory = PROCESS_BYTES + METHODS[first.method].bytes_of_unknown * unknowns
    return Batch(tuple(members), unknowns, time, memory)


def seconds(cases: Iterable[Case]) -> float:
    """Time of cases on one core, to a factor of about two, or four with contact [s]."""
    return sum(seconds_of_states(case, case.states) + seconds_to_measure(case) for case in cases)


def seconds_of_states(case: Case, states: float) -> float:
    """Time of the first states of a case [s]."""
    method = METHODS[case.method]
    return method.seconds_of_work * method.work(case, states) + SECONDS_OF_STATE * states


def seconds_to_measure(case: Case) -> float:
    """Time of the capacitances of a case; all else is soon measured [s]."""
    if case.capacitor is None:
        return 0.0
    cells = sum(strip.area for strips in case.electrodes.strips for strip in strips)
    states = len(case.applied_strain) * (2 if case.unloading else 1)
    return SECONDS_OF_CAPACITANCE * states * (cells / 100) ** CAPACITANCE_POWER


def workers_that_fit(batches: Sequence[Batch], workers: int, memory: float | None = None) -> int:
    """Number of workers whose batches fit into a memory [bytes], by default of this job."""
    memory = job_limits.memory() if memory is None else memory
    needs = sorted((batch.estimated_bytes for batch in batches), reverse=True)
    if needs and needs[0] > memory:
        largest = f"batch of {max(batch.unknowns for batch in batches):,} unknowns"
        sizes = f"needs about {needs[0] / 1e9:.1f} GB, and this job has {memory / 1e9:.1f} GB"
        raise invalid(largest, f"{sizes}; take fewer unit_cells or more memory")
    while workers > 1 and sum(needs[:workers]) > memory:
        workers -= 1
    return workers


def split(
    batches: Sequence[Batch], cases: Mapping[str, Case], count: int
) -> list[tuple[Batch, ...]]:
    """The batches of each shard of a plan: the longest first, to the shard that has least to do."""
    whole = math.fsum(batch.estimated_seconds for batch in batches)
    longest = whole / count / BATCHES_OF_SHARD  # unless a single case takes longer
    pieces: list[tuple[float, Batch]] = []
    for batch in batches:
        times = _rounded(batch.estimated_seconds / longest) if longest else 1.0
        number = min(len(batch.cases), max(1, math.ceil(times)))
        for members in np.array_split(batch.cases, number):
            piece = _batch_of(members.tolist(), cases)
            pieces.append((_rounded(piece.estimated_seconds), piece))
    shards: list[list[Batch]] = [[] for _ in range(count)]
    loads = [(0.0, number) for number in range(count)]
    for cost, piece in sorted(pieces, key=lambda pair: (-pair[0], pair[1].cases)):
        load, number = loads[0]
        heapq.heapreplace(loads, (load + cost, number))
        shards[number].append(piece)
    return [tuple(shard) for shard in shards]


def _rounded(time: float) -> float:
    return float(f"{time:.{DIGITS}g}")
