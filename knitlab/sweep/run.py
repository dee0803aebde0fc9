"""Running a plan: missing cases are simulated, then the cube is built."""

import itertools
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import xarray as xr

from knitlab.cube.case_file import case_path, read_case
from knitlab.cube.common_settings import differences, parameters_of
from knitlab.cube.cube_file import CUBE
from knitlab.cube.schema import Status
from knitlab.io.atomic_write import clear_unfinished
from knitlab.io.errors import BadInput, Fault
from knitlab.io.lock import gate, held, held_by_shard, running_shards
from knitlab.simulation.case import Case
from knitlab.simulation.simulate import simulate_batch
from knitlab.sweep.interruption import interrupted_by_signals
from knitlab.sweep.join import (
    Failed,
    Failure,
    failure_entries,
    join,
    joined_again,
    part_cube,
    previous_cube,
)
from knitlab.sweep.memory import workers_that_fit
from knitlab.sweep.plan import Plan
from knitlab.sweep.progress import ProgressBar
from knitlab.sweep.shard import Shard, part_of
from knitlab.sweep.shard_record import ShardRecord, record_path, write_record
from knitlab.sweep.status import FAILURES, PLAN, check_same_plan
from knitlab.sweep.survey import CaseState, survey
from knitlab.sweep.workers import Pool, SchedulerLost, Simulate, Task, connected, pool_of

ONE_BY_ONE = 2
"""Number of attempts after which batches are run one by one."""


@dataclass(frozen=True)
class RunOptions:
    """How a plan is run; none of these options changes a result.

    Attributes:
        workers: processes on this machine; 0 simulates in this process. With None a single batch is
            simulated in this process, which is ready sooner, and several by one process for each
            processor.
        scheduler: address of an existing dask scheduler, whose workers see the results folder.
        retries: how often a batch that raised is tried again unchanged.
        fail_fast: whether to stop at the first case that is not ok.
        case_timeout: longest time for a case, if any [s].
        refresh: whether to recompute stale results.
        shard: the part of the plan that is simulated; None simulates all of it.
        dashboard: whether to open dask's dashboard.
        show_progress: whether to draw a progress bar.
        simulate: function that simulates a batch.
    """

    workers: int | None = 0
    scheduler: str | None = None
    retries: int = 0
    fail_fast: bool = False
    case_timeout: float | None = None
    refresh: bool = False
    shard: Shard | None = None
    dashboard: bool = False
    show_progress: bool = False
    simulate: Simulate = simulate_batch

    def __post_init__(self) -> None:
        """Refuse numbers that no run can have.

        Raises:
            BadInput: with every one of them.
        """
        workers = 0 if self.workers is None else self.workers
        faults = [
            Fault(f"{name} {number}", "is not a whole number; give 0 or more")
            for name, number in (("workers", workers), ("retries", self.retries))
            if not isinstance(number, int) or number < 0
        ]
        if self.case_timeout is not None and not self.case_timeout > 0:
            faults.append(Fault(f"case_timeout {self.case_timeout}", "is not above 0; raise it"))
        if faults:
            raise BadInput(faults)

    def processors(self, batches: int) -> int:
        """Processes on this machine for a number of batches, or 0 for this one."""
        if self.workers is not None:
            return self.workers
        # A separate process can be stopped, and its crash does not end the run.
        return 0 if batches == 1 and self.case_timeout is None else os.cpu_count() or 1


@dataclass(frozen=True)
class Run:
    """The result of a run.

    Attributes:
        cube: the cube, as written; of a shard, the designs of its part alone.
        simulated: identifiers of the cases that this run simulated.
        states_before: state of every planned case before the run, by identifier.
        failures: an entry with its reason for each case that is not ok.
        stopped: whether the run was interrupted.
        changed: differences to the parameters of stale results.
        joined: whether ``cube.nc`` was written; it is left to other shards that still run.
    """

    cube: xr.Dataset
    simulated: tuple[str, ...]
    states_before: dict[str, CaseState]
    failures: tuple[Failure, ...]
    stopped: bool
    changed: tuple[str, ...] = ()
    joined: bool = True

    def in_state(self, state: CaseState) -> tuple[str, ...]:
        """Identifiers of the cases that were in a state before the run."""
        return tuple(case_id for case_id, before in self.states_before.items() if before is state)

    @property
    def reused(self) -> tuple[str, ...]:
        """Identifiers of cases whose results were reused, even if other code computed them."""
        stored = {*self.in_state(CaseState.done), *self.in_state(CaseState.stale_code)}
        return tuple(stored - set(self.simulated))

    @property
    def stale_code(self) -> tuple[str, ...]:
        """Identifiers of cases whose results are still of other code."""
        return tuple(set(self.in_state(CaseState.stale_code)) - set(self.simulated))

    @property
    def stale_parameters(self) -> tuple[str, ...]:
        """Identifiers of cases whose results are still of other parameters."""
        return tuple(set(self.in_state(CaseState.stale_parameters)) - set(self.simulated))

    @property
    def unfinished(self) -> tuple[str, ...]:
        """Identifiers of cases without a result."""
        without = {*self.in_state(CaseState.pending), *self.in_state(CaseState.damaged)}
        return tuple(without - set(self.simulated))

    def remarks(self, folder: Path) -> list[str]:
        """Remarks about damaged, failed, stale and unfinished cases, one line each."""
        lines = [
            f"damaged: {case_path(folder, case_id)} was not as it had been written"
            for case_id in self.in_state(CaseState.damaged)
        ]
        if self.failures:
            lines.append(f"for details of one case: knitlab reproduce CASE_ID (see {FAILURES})")
        if self.stale_code:
            lines.append(
                f"stale: {len(self.stale_code)} cases were computed by other code and are kept;"
                " a refresh recomputes them"
            )
        if self.stale_parameters:
            lines.append(
                f"stale: {len(self.stale_parameters)} cases are kept as computed with other"
                f" parameters ({'; '.join(self.changed) or 'of single designs'}); a refresh"
                " recomputes them, another results folder keeps both"
            )
        if self.stopped:
            left = len(self.unfinished)
            noun = "case is" if left == 1 else "cases are"
            lines.append(
                f"stopped: finished cases are kept, {left} {noun} left; run again to continue"
            )
        return lines


@dataclass
class RunProgress:
    """Cases that have ended or failed so far; kept when the run is interrupted."""

    ended: set[str] = field(default_factory=set)
    failed: Failed = field(default_factory=dict)


def run_plan(plan: Plan, results: Path, options: RunOptions) -> Run:
    """Simulate the cases of a plan that have no undamaged file, then write ``cube.nc``.

    Results of other code or parameters are kept unless ``options.refresh``. A batch that raises or
    whose worker dies is tried again, then each of its cases on its own; a case that still has no
    result is ``failed``. Ctrl-C and SIGTERM keep finished cases.

    A shard simulates its part beside other shards; the last one to end writes ``cube.nc`` with the
    cases of all.

    Args:
        plan: the plan, which is written to ``plan.json``.
        results: results folder of the workflow.
        options: how to run it.

    Raises:
        BadInput: if another run holds the folder, its cube has other dimensions, shards of another
            plan run there, or a batch needs more memory than the machine has.
        CannotWrite: if the folder cannot be written, or is full; finished cases are kept.
    """
    if options.scheduler is not None:
        connected(options.scheduler).close()  # before anything is written
    shard = options.shard
    part = plan if shard is None else part_of(plan, shard)
    with held(results) if shard is None else held_by_shard(results, shard.number, shard.count):
        with gate(results):
            old = _begin(plan, results, shard)
        states = survey(part.designs, results, old, check=True)
        missing = {
            case_id: part.cases[case_id]
            for case_id, state in states.items()
            if state in (CaseState.pending, CaseState.damaged) or (state.stale and options.refresh)
        }
        progress = RunProgress()
        with interrupted_by_signals():
            stopped = _simulate_all(part, results, missing, options, progress)
        simulated = tuple(case_id for case_id in missing if case_id in progress.ended)
        if shard is None:
            joined = True
            cube, failures = join(plan, results, old, states, simulated, progress.failed)
        else:
            cube = part_cube(plan, part, results, states, simulated, progress.failed)
            failures = tuple(failure_entries(part, results, cube, simulated, progress.failed))
            with gate(results):
                path = record_path(results, shard.number, shard.count)
                write_record(path, ShardRecord(simulated, failures))
                if joined := not _others(results, shard):
                    joined_again(plan, results, simulated, progress.failed)
    kept = [case_id for case_id, state in states.items() if state is CaseState.stale_parameters]
    stale = set(kept) - set(simulated)
    planned = tuple(entry for entry in failures if entry["case_id"] in part.cases)
    changed = differences(parameters_of(old), plan.common) if old is not None and stale else ()
    return Run(cube, simulated, states, planned, stopped, tuple(map(str, changed)), joined)


def _begin(plan: Plan, results: Path, shard: Shard | None) -> xr.Dataset | None:
    """Write the plan into a results folder, unless other shards run there; the cube before it.

    Raises:
        BadInput: if the cube does not fit the plan, or the other shards have another plan.
    """
    old = previous_cube(plan, results / CUBE)
    # Another shard that has its lock may still wait at the gate, without a plan written.
    if shard is not None and (results / PLAN).exists() and _others(results, shard):
        check_same_plan(plan, results)
    else:
        clear_unfinished(results)
        plan.write(results / PLAN)
    return old


def _others(results: Path, shard: Shard) -> list[tuple[int, int]]:
    """The other shards that run in a folder."""
    own = shard.number, shard.count
    return [running for running in running_shards(results) if running != own]


def _simulate_all(
    plan: Plan, results: Path, missing: dict[str, Case], options: RunOptions, progress: RunProgress
) -> bool:
    """Simulate the missing cases; returns whether the run was interrupted."""
    planned = [batch for batch in plan.batches if any(case in missing for case in batch.cases)]
    batches = [
        [missing[case_id] for case_id in batch.cases if case_id in missing] for batch in planned
    ]
    if not batches:
        return False
    processors = options.processors(len(batches))
    workers = min(processors, len(batches))
    if options.scheduler is None:
        workers = workers_that_fit(planned, workers)
    # Processors without a batch go to the others as threads; those of a scheduler are not known.
    threads = 1 if options.scheduler else processors // max(workers, 1)
    task = Task(options.simulate, results.resolve(), options.case_timeout, threads)
    with ProgressBar(missing, shown=options.show_progress) as bar:
        try:
            with pool_of(task, workers, options.scheduler, options.dashboard, bar.reached) as pool:
                try:
                    return _in_rounds(pool, batches, results, options, progress, bar)
                except KeyboardInterrupt:
                    bar.write("stopping: the workers end and the cube is written; wait a moment")
                    raise
        except KeyboardInterrupt:
            return True
        except SchedulerLost:
            bar.write("stopping: the dask scheduler ended or cannot be reached")
            return True


def _in_rounds(
    pool: Pool,
    batches: Sequence[Sequence[Case]],
    results: Path,
    options: RunOptions,
    progress: RunProgress,
    bar: ProgressBar,
) -> bool:
    """Simulate batches, and repeat those that need it; returns whether the run was stopped.

    A batch may be lost because another batch killed the worker that it was assigned to. A batch
    that was lost twice is therefore run alone, where only itself can kill its worker.
    """
    attempts = 0
    while batches:
        again: list[Sequence[Case]] = []
        together = [[batch] for batch in batches] if attempts >= ONE_BY_ONE else [batches]
        for batch, error in itertools.chain.from_iterable(map(pool, together)):
            if error and error.cannot_write:
                raise error.cannot_write
            if error and (attempts < options.retries or (error.lost and attempts < ONE_BY_ONE)):
                again.append(batch)
            elif error and len(batch) > 1:
                again += [[case] for case in batch]
            else:
                for case in batch:
                    bar.ended(case.case_id)
                    if error:
                        progress.failed[case.case_id] = error
                    else:
                        progress.ended.add(case.case_id)
                if options.fail_fast and (error or not _all_ok(results, batch)):
                    return True
        batches, attempts = again, attempts + 1
    return False


def _all_ok(results: Path, batch: Sequence[Case]) -> bool:
    return all(read_case(results, case.case_id)["status"] == Status.ok for case in batch)
