"""Running a plan: missing cases are simulated, then the cube is built."""

import itertools
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import xarray as xr

from knitlab.cubes.case_file import case_path, read_case, stored_cases
from knitlab.cubes.common_settings import differences
from knitlab.cubes.cube_file import parameters_of, write_cube
from knitlab.io.atomic_write import clear_unfinished
from knitlab.io.cube_path import CUBE
from knitlab.io.errors import invalid
from knitlab.io.lock import brief_lock, locked, running_shards
from knitlab.io.progress import Progress
from knitlab.io.provenance import MODEL
from knitlab.observables.status import Status
from knitlab.runs import results_folder, workers
from knitlab.runs.batches import Shard, workers_that_fit
from knitlab.runs.cube import DAMAGED_CUBE, build_cube, previous_cube, unused_folder
from knitlab.runs.plan import Plan
from knitlab.runs.progress import CaseProgress
from knitlab.runs.recorded_plan import PLAN, read_plan
from knitlab.runs.results_folder import (
    FAILURES,
    CaseState,
    Check,
    Failure,
    case_states,
    cube_designs,
    earlier_failures,
    stored_statuses,
)
from knitlab.runs.run_options import RunOptions
from knitlab.runs.workers import BatchError, SchedulerLost, Simulate, Task
from knitlab.solvers.case import Case

ONE_BY_ONE = 2  # number of attempts after which batches are run one by one


@dataclass(frozen=True)
class Run:
    """The result of a run; cases are named by their identifiers."""

    make_cube: Callable[[], xr.Dataset]
    simulated: tuple[str, ...]
    states_before: dict[str, CaseState]
    failures: tuple[Failure, ...]
    stopped: bool
    changed: tuple[str, ...]  # differences to the parameters of the cube before the run
    joined: bool  # whether ``cube.nc`` was written; it is left to other shards that still run
    rebuilt: bool = False  # whether the cube before the run was damaged

    @cached_property
    def cube(self) -> xr.Dataset:
        """The cube as written; of a shard the designs of its share alone, from its case files."""
        return self.make_cube()

    def left_in(self, *states: CaseState) -> set[str]:
        """The cases that were in one of some states before the run, which did not simulate them."""
        before = {case_id for case_id, state in self.states_before.items() if state in states}
        return before.difference(self.simulated)

    @property
    def all_ok(self) -> bool:
        """Whether every case is ok and was computed with the requested parameters."""
        return not (self.failures or self.stopped or self.left_in(CaseState.stale_parameters))

    def remarks(self, dims: Sequence[str], folder: Path) -> list[str]:
        """One line for each case that is not ok, then on damaged, stale and unfinished ones."""
        lines = []
        for entry in self.failures:
            label = results_folder.label_text(dims, [entry[name] for name in dims])
            lines.append(f"{entry['status']}: {label}: {entry['reason']}")
        for case_id, state in self.states_before.items():
            if state is CaseState.damaged:
                lines.append(f"damaged: {case_path(folder, case_id)} was not as written")
        if self.rebuilt:
            path = folder / CUBE
            lines.append(f"damaged: {path} was not as written; it is kept as {DAMAGED_CUBE}")
        if self.failures:
            lines.append(f"for details of one case: knitlab reproduce CASE_ID (see {FAILURES})")
        if stale := len(self.left_in(CaseState.stale_code)):
            kept = f"stale: {stale} cases of another model are kept"
            lines.append(f"{kept}; give refresh = True to compute them again")
        if stale := len(self.left_in(CaseState.stale_parameters)):
            listed = "; ".join(self.changed) or "of single designs"
            kept = f"stale: {stale} cases are kept as computed with other parameters ({listed})"
            hint = "give refresh = True to compute them again"
            other = unused_folder(folder.parent)
            lines.append(f"{kept}; {hint}, or results = {other} to keep both")
        if self.stopped:
            left = len(self.left_in(CaseState.pending, CaseState.damaged))
            left_over = "1 case is left" if left == 1 else f"{left} cases are left"
            lines.append(f"stopped: finished cases are kept, {left_over}; run again to continue")
        return lines


def run_plan(plan: Plan, results: Path, options: RunOptions) -> Run:
    """Simulate the cases of a plan that have no undamaged file, then write ``cube.nc``.

    A batch that raises or whose worker dies is tried again, then each of its cases on its own; a
    case that still has no result is ``failed``. The last of several shards to end writes the cube.
    """
    if options.scheduler is not None:
        workers.connected(options.scheduler).close()  # before anything is written
    shard = options.shard
    share = plan if shard is None else plan.share(shard)
    with locked(results, (1, 1) if shard is None else (shard.number, shard.count)):
        with brief_lock(results):
            was_there = (results / CUBE).exists()
            old = previous_cube(plan, results / CUBE, options.refresh)
            # Another shard that has its lock may still wait to write its plan.
            if (results / PLAN).exists() and _others_run(results, shard):
                recorded = read_plan(results)
                same_model = recorded["code"] == MODEL
                if not same_model or recorded["cases"].keys() != plan.cases.keys():
                    message = "has other cases or another model than this plan, and its shards run"
                    hint = "wait for them, or name another results folder"
                    raise invalid(str(results / PLAN), f"{message}; {hint}")
            else:
                clear_unfinished(results)
                plan.write(results / PLAN)
        in_cube = cube_designs(old)
        states = case_states(share.designs, results, in_cube, Check.changed)
        wanted = {CaseState.pending, CaseState.damaged}
        unconverged = set[str]()
        if options.refresh:
            wanted |= {CaseState.stale_code, CaseState.stale_parameters}
            unconverged = {
                each.case_id for each in in_cube.values() if each.status is Status.not_converged
            }
        missing = {
            case_id: share.cases[case_id]
            for case_id, state in states.items()
            if state in wanted or case_id in unconverged
        }
        before = stored_cases(results)
        with workers.interrupted_by_signals() as asked:
            done = _simulate(share, results, missing, options, asked)
        if done.stopped:  # a batch that did not end may have written some of its cases
            written = stored_cases(results)
            done.ended |= {name for name in missing if written.get(name) != before.get(name)}
        if shard is None:
            with Progress("cube", options.show_progress, total=None):
                cube, failures = _join(plan, results, old, states, done)
            make_cube, joined = (lambda: cube), True
        else:
            # Without cases in the share, the cube has all designs, as pending.
            after = states | dict.fromkeys(done.ended, CaseState.pending)
            nothing = dict.fromkeys(plan.cases, CaseState.damaged)
            designs, known = (share, after) if share.cases else (plan, nothing)
            make_cube = partial(build_cube, designs, results, [], known, done.failed)
            undamaged = [name for name, state in after.items() if state is not CaseState.damaged]
            failures = _failures(share, results, stored_statuses(results, undamaged), done)
            with brief_lock(results):
                others = earlier_failures(results).items()
                kept = [entry for case_id, entry in others if case_id not in share.cases]
                results_folder.write_failures(results, [*kept, *failures])
                joined = not _others_run(results, shard)
                if joined:
                    # Others may have written the cube while this shard was running.
                    now = previous_cube(plan, results / CUBE, options.refresh)
                    after = case_states(plan.designs, results, cube_designs(now), Check.changed)
                    _join(plan, results, now, after, done)
    changed = () if old is None else differences(parameters_of(old), plan.common)
    return Run(
        make_cube,
        simulated=tuple(sorted(done.ended)),
        states_before=states,
        failures=failures,
        stopped=done.stopped,
        changed=tuple(map(str, changed)),
        joined=joined,
        rebuilt=was_there and old is None,
    )


def _others_run(results: Path, shard: Shard | None) -> bool:
    """Whether other shards run in a folder."""
    if shard is None:
        return False
    return any(other != (shard.number, shard.count) for other in running_shards(results))


@dataclass
class _Simulated:
    ended: set[str] = field(default_factory=set)
    failed: dict[str, BatchError] = field(default_factory=dict)  # why they have no results
    stopped: bool = False


def _simulate(
    plan: Plan,
    results: Path,
    missing: Mapping[str, Case],
    options: RunOptions,
    asked: threading.Event,
) -> _Simulated:
    """Simulate cases; a batch that was lost twice is run alone, where it can kill no other."""
    done = _Simulated()
    planned = [batch for batch in plan.batches if not missing.keys().isdisjoint(batch.cases)]
    if not planned:
        return done
    batches: list[Sequence[Case]] = [
        [missing[case_id] for case_id in batch.cases if case_id in missing] for batch in planned
    ]
    processors = options.processors(len(batches))
    count = min(processors, len(batches))
    if options.scheduler is None:
        count = workers_that_fit(planned, count)
    # Processors without a batch go to the others as threads; those of a scheduler are not known.
    threads = 1 if options.scheduler else processors // max(count, 1)
    task = Task(options.simulate or _simulation(), results.resolve(), options.case_timeout, threads)

    def reached(case_id: str, states: float, doing: str = "") -> None:
        # An exception that a signal raises is lost in a callback of JAX, as that of the collector.
        if asked.is_set() and threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        bar.reached(case_id, states, doing)

    with (
        CaseProgress(missing, options.show_progress, max(count, 1)) as bar,
        _until_stopped(bar, done),  # while the workers end
        workers.worker_pool(task, count, options.scheduler, options.dashboard, reached) as pool,
        _until_stopped(bar, done),
    ):
        attempts = 0
        while batches:
            to_retry: list[Sequence[Case]] = []
            groups = [[batch] for batch in batches] if attempts >= ONE_BY_ONE else [batches]
            for batch, error in itertools.chain.from_iterable(map(pool, groups)):
                if error and error.machine_error:
                    raise error.machine_error
                if error and (attempts < options.retries or (error.lost and attempts < ONE_BY_ONE)):
                    to_retry.append(batch)
                    continue
                if error and len(batch) > 1:
                    to_retry += [[case] for case in batch]
                    continue
                for case_id in (case.case_id for case in batch):
                    bar.ended(case_id)
                    if error:
                        done.failed[case_id] = error
                    else:
                        done.ended.add(case_id)
                    if options.fail_fast:
                        ok = not error and read_case(results, case_id)["status"] == Status.ok
                        done.stopped |= not ok
                done.stopped |= asked.is_set()
                if done.stopped:
                    return done
            batches = to_retry
            attempts += 1
    return done


def _simulation() -> Simulate:
    from knitlab.runs.simulate import simulate_batch  # imports JAX

    return simulate_batch


@contextmanager
def _until_stopped(bar: CaseProgress, done: _Simulated) -> Iterator[None]:
    """End a step of a run early, but not the run, if it is interrupted or its scheduler is lost."""
    try:
        yield
    except KeyboardInterrupt:
        done.stopped = True
        bar.write("stopping: the workers end and the cube is written; wait a moment")
    except SchedulerLost:
        done.stopped = True
        bar.write("stopping: the dask scheduler ended or cannot be reached")


def _join(
    plan: Plan,
    results: Path,
    old: xr.Dataset | None,
    states: dict[str, CaseState],
    done: _Simulated,
) -> tuple[xr.Dataset, tuple[Failure, ...]]:
    """Write the cube and the failures of a folder, with the states of its cases before the run."""
    failed = results_folder.failed_cases(earlier_failures(results)) | done.failed.keys()
    after = states | dict.fromkeys(done.ended, CaseState.pending)
    sources = [] if old is None else [old]
    cube = build_cube(plan, results, sources, after, failed)
    cube = write_cube(cube, results / CUBE, sources)
    results_folder.doubt(results, (name for name in after if after[name] is CaseState.damaged))
    statuses = {each.case_id: each.status for each in cube_designs(cube).values()}
    failures = _failures(plan, results, statuses, done)
    results_folder.write_failures(results, failures)
    return cube, tuple(entry for entry in failures if entry["case_id"] in plan.cases)


def _failures(
    plan: Plan, results: Path, statuses: Mapping[str, Status], done: _Simulated
) -> tuple[Failure, ...]:
    """For every case that is not ok the reason, and the record to run it alone."""
    earlier = earlier_failures(results)
    not_ok = (Status.not_converged, Status.failed)
    bad = [case_id for case_id, status in statuses.items() if status in not_ok]
    entries = []
    # A case that failed when it was refreshed keeps its old results in the cube.
    for case_id in dict.fromkeys([*bad, *done.failed]):
        error = done.failed.get(case_id)
        if case_id in earlier and case_id not in done.ended and not error:
            entries.append(earlier[case_id])
        elif case := plan.cases.get(case_id):
            reason = error.reason if error else read_case(results, case_id).attrs["reason"]
            status = Status.failed if error else Status.not_converged
            entry = {"case_id": case_id, **case.design, "status": status.name}
            entry |= {"reason": str(reason), "trace": error.trace if error else ""}
            entries.append(entry | {"case": case.record})
    return tuple(entries)
