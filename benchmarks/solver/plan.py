"""What a run measures, in groups."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.solver.limit import FACTORISATIONS
from benchmarks.solver.measurement import Measurement
from benchmarks.solver.methods import SOLVERS, SWEPT, TRIALS, installed
from knitlab.model.settings import Boundary
from knitlab.runs.parameters import defaults

COMPARED = ("1x1", "3x2", "5x3", "7x5")
"""Samples of (4, 16) that every method relaxes and pulls, unit cells along (y, x)."""
GROWING = ("2x2", "4x2", "6x3", "8x4", "12x6", "16x8", "22x11", "44x22")
"""Samples from 1,000 to 249,000 nodes."""
FACTORED = ("6x4", "24x11")
"""Samples of about 20,000 and 200,000 free unknowns between the clamps."""
TUNED = ("1x1", "3x2")
"""Samples that settings are tried on: the first for itself, the second for all that are larger."""
EVERY_DESIGN: tuple[tuple[Boundary, str], ...] = (("periodic", "1x1"), ("clamped", "5x3"))


@dataclass(frozen=True)
class Budget:
    """How much a run may do.

    Attributes:
        repeats: of every measurement.
        time_limit: of one [s].
        once_above: time above which a measurement is not repeated [s].
    """

    repeats: int = 3
    time_limit: float = 3600.0
    once_above: float = 600.0


def tuning() -> Iterator[Measurement]:
    """Values of the one number of every method that has one, on small samples."""
    for size in TUNED:
        for solver, settings in TRIALS.items():
            for setting in settings:
                yield Measurement("tuning", solver, size=size, setting=setting)


def methods() -> Iterator[Measurement]:
    """Relaxation, and relaxation with 15 load steps, by every method."""
    for size in COMPARED:
        for solver in SOLVERS:
            yield Measurement("relaxation", solver, size=size)
            yield Measurement("tension", solver, size=size)


def limit() -> Iterator[Measurement]:
    """One iteration, by every factorisation, by one thread and two."""
    for size in FACTORED:
        for solver in FACTORISATIONS:
            for threads in (1, 2):
                yield Measurement("iteration", solver, size=size, workers=threads)


def scaling() -> Iterator[Measurement]:
    """Relaxation and 15 load steps by knitlab, as a sweep does them, on ever larger samples.

    Two threads share each, as they do where a sweep has one case for two processors.
    """
    for solver in SWEPT:
        for size in GROWING:
            yield Measurement("tension", solver, size=size, workers=2)


def iterations() -> Iterator[Measurement]:
    """Relaxation of all the paper's designs as a sweep does it."""
    designs = defaults().designs.root["paper"].pairs
    for boundary, size in EVERY_DESIGN:
        for n_stripe, n_subunit in designs:
            yield Measurement("shipped_relaxation", "knitlab", n_stripe, n_subunit, size, boundary)


def many() -> Iterator[Measurement]:
    """A cold sweep over all the paper's designs, by one worker and by two."""
    for workers in (1, 2):
        yield Measurement("sweep", "knitlab", size="paper", boundary="periodic", workers=workers)


GROUPS: dict[str, Callable[[], Iterator[Measurement]]] = {
    "limit": limit,
    "tuning": tuning,
    "methods": methods,
    "scaling": scaling,
    "many": many,
    "iterations": iterations,
}

COUNTED = ("tuning", "iterations")
"""Groups that ask how many evaluations or factorisations it takes, which no repeat changes."""


def planned(groups: Sequence[str], budget: Budget, results: Path) -> Iterator[Measurement]:
    """The measurements of some groups, all repeats; what is tuned takes its best setting.

    It looks at the records as it goes: tuning comes before what it tunes, and what took long or
    was given up is not repeated.
    """
    for group in (group for group in GROUPS if group in groups):
        for repeat in range(1 if group in COUNTED else budget.repeats):
            for measurement in GROUPS[group]():
                if not installed(measurement.solver):
                    continue
                first = replace(measurement, time_limit=budget.time_limit)
                if first.setting is None:
                    first = replace(first, setting=best_setting(first, results))
                record = first.record(results) or {"reached": False}
                if repeat == 0 or (record["reached"] and record["seconds"] <= budget.once_above):
                    yield replace(first, repeat=repeat)


def best_setting(measurement: Measurement, results: Path) -> float | None:
    """The setting that took the fewest evaluations on a small sample, of those tried.

    Where none has reached the tolerance there, the sample before it decides; ``None`` if none has
    at all.
    """
    samples = TUNED[:1] if measurement.size == TUNED[0] else TUNED[::-1]
    for size in samples:
        costs: dict[float, int] = {}
        for trial in tuning():
            if (trial.solver, trial.size) == (measurement.solver, size):
                record = trial.record(results)
                if record and record["reached"] and trial.setting is not None:
                    costs[trial.setting] = record["evaluations"]
        if costs:
            return min(costs, key=lambda setting: costs[setting])
    return None
