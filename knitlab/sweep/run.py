"""Running a plan: what is missing is simulated, then one writer builds the cube."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from knitlab.sweep.case import Case
from knitlab.sweep.case_file import case_path, read_case
from knitlab.sweep.cube import build_cube, write_cube
from knitlab.sweep.files import written_whole
from knitlab.sweep.plan import Plan
from knitlab.sweep.progress import ProgressBar
from knitlab.sweep.registry import Status
from knitlab.sweep.workers import Pool, pool_of


@dataclass(frozen=True)
class Run:
    """What a run left behind.

    Attributes:
        cube: the cube, as written.
        simulated: identifiers of the cases that this run simulated.
        reused: how many were there already.
        failures: what each case that is not ok says of itself.
    """

    cube: xr.Dataset
    simulated: tuple[str, ...]
    reused: int
    failures: tuple[dict[str, object], ...]


def run_plan(
    plan: Plan,
    results: Path,
    workers: int,
    scheduler: str | None = None,
    show_progress: bool = False,
) -> Run:
    """Simulate the cases of a plan that have no file yet, then write ``cube.nc``.

    A case whose worker raises is ``failed``; its batch mates are run again without it.

    Args:
        plan: the plan, frozen here into ``plan.json``.
        results: results folder of the workflow.
        workers: processes on this machine; 0 simulates in this process.
        scheduler: address of an existing dask scheduler, whose workers see ``results``.
        show_progress: whether to draw a progress bar.
    """
    missing = {
        case_id: case
        for case_id, case in plan.cases.items()
        if not case_path(results, case_id).is_file()
    }
    batches = [
        batch
        for planned in plan.batches
        if (batch := [missing[case_id] for case_id in planned if case_id in missing])
    ]
    workers, scheduler = min(workers, len(batches)), scheduler if batches else None
    with (
        ProgressBar(missing, shown=show_progress and bool(batches)) as bar,
        pool_of(workers, scheduler, bar.reached) as pool,
    ):
        plan.write(results / "plan.json")
        failed = _simulate(pool, results.resolve(), batches, bar)
    cube = build_cube(plan, results, failed)
    write_cube(cube, results / "cube.nc")
    failures = _failures(plan, results, cube, failed)
    with written_whole(results / "failures.jsonl") as temporary:
        temporary.write_text("".join(json.dumps(entry) + "\n" for entry in failures))
    simulated = tuple(case_id for case_id in missing if case_id not in failed)
    return Run(cube, simulated, len(plan.cases) - len(missing), tuple(failures))


def _simulate(
    pool: Pool, results: Path, batches: Sequence[Sequence[Case]], bar: ProgressBar
) -> dict[str, str]:
    failed: dict[str, str] = {}
    alone: list[list[Case]] = []
    for batch, error in pool(results, batches):
        if error and len(batch) > 1:
            alone += [[case] for case in batch]
            continue
        for case in batch:
            bar.ended(case.case_id)
            if error:
                failed[case.case_id] = error.reason
    return failed | _simulate(pool, results, alone, bar) if alone else failed


def _failures(
    plan: Plan, results: Path, cube: xr.Dataset, failed: dict[str, str]
) -> list[dict[str, object]]:
    entries: list[dict[str, object]] = []
    for case_id, case in plan.cases.items():
        status = Status(int(cube["status"].sel(case.design)))
        if status is Status.ok:
            continue
        reason = failed.get(case_id) or read_case(results, case_id).attrs["reason"]
        entries.append({"case_id": case_id, **case.design, "status": status.name, "reason": reason})
    return entries
