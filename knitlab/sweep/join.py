"""Joining: the shared files of a results folder, from what a run or the shards of a plan left."""

import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cube.case_file import read_case
from knitlab.cube.common_settings import differences, parameters_of
from knitlab.cube.cube_file import CUBE, open_cube, write_cube
from knitlab.cube.schema import Status
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, fault
from knitlab.sweep.cube import build_cube
from knitlab.sweep.plan import Plan
from knitlab.sweep.shard_record import read_records, remove_records, simulated_by
from knitlab.sweep.status import FAILURES, earlier_failures
from knitlab.sweep.survey import CaseState, cells, check_dims, survey
from knitlab.sweep.workers import BatchError

MAY_DIFFER = ("applied_strain", "unit_cells", "solver", "sensitivities", "unloading", "robustness")
"""Parameters in which designs of one cube may differ: strains, sample size (which the cube has for
each design, as ``unit_cells_y`` and ``unit_cells_x``), solver settings, and whether sensitivities,
unloading or siblings are requested."""
Failed = dict[str, BatchError]
"""Why cases could not be computed, by identifier."""
Failure = dict[str, Any]
"""An entry of ``failures.jsonl``: a design that is not ok, and why."""


def previous_cube(plan: Plan, path: Path) -> xr.Dataset | None:
    """The existing cube, if there is one.

    Raises:
        BadInput: if it cannot be read, or the plan's designs cannot be added to it.
    """
    if not path.exists():
        return None
    try:
        cube = open_cube(path)
    except BadInput as error:
        problem = "cannot be read; remove it and run again: it is rebuilt from the case files"
        raise fault(str(path), problem) from error
    check_dims(cube, plan.dims, path)
    others = set(cells(cube)) - set(plan.designs.values())
    changed = differences(parameters_of(cube), plan.common)
    changed = tuple(change for change in changed if change.key[0] not in MAY_DIFFER)
    if others and changed:
        listed = "; ".join(map(str, changed))
        raise fault(
            str(path),
            f"holds {len(others)} designs computed otherwise ({listed}); name another"
            " results folder, or list the values of a setting to make it a dimension",
        )
    return cube


def join(
    plan: Plan,
    results: Path,
    old: xr.Dataset | None,
    states: Mapping[str, CaseState],
    simulated: Collection[str],
    failed: Failed,
) -> tuple[xr.Dataset, tuple[Failure, ...]]:
    """Write the cube and ``failures.jsonl`` of a plan, with what shards recorded.

    Args:
        plan: the plan.
        results: results folder of the workflow, which no other process may write.
        old: the previous cube, see :func:`previous_cube`.
        states: state of every planned case, by identifier, before ``simulated`` were.
        simulated: identifiers of the cases that this process simulated.
        failed: why it could not compute some.

    Returns:
        The cube, and the entries of its failures.

    Raises:
        CannotWrite: if they cannot be written.
    """
    records = read_records(results)
    elsewhere = simulated_by(records)
    failed_elsewhere = {
        entry["case_id"]
        for record in records
        for entry in record.failures
        if entry["status"] == Status.failed.name
        and states.get(entry["case_id"]) not in (CaseState.done, CaseState.stale_code)
    } - set(simulated)

    def left(state: CaseState) -> set[str]:
        found = {case_id for case_id, its in states.items() if its is state}
        return found - set(simulated)

    cube = build_cube(
        plan,
        results,
        old,
        {*simulated, *elsewhere},
        left(CaseState.stale_parameters),
        {*failed, *failed_elsewhere},
        left(CaseState.damaged),
    )
    failures = tuple(failure_entries(plan, results, cube, simulated, failed))
    write_cube(cube, results / CUBE)
    with atomic_write(results / FAILURES) as temporary:
        temporary.write_text("".join(json.dumps(entry) + "\n" for entry in failures))
    remove_records(results)
    return cube, failures


def part_cube(
    plan: Plan,
    part: Plan,
    results: Path,
    states: Mapping[str, CaseState],
    simulated: Collection[str],
    failed: Failed,
) -> xr.Dataset:
    """The cube of one shard's designs; of the whole plan, all ``pending``, if it has none.

    Args:
        plan: the plan.
        part: its part, see :func:`knitlab.sweep.shard.part_of`.
        results: results folder of the workflow.
        states: state of every case of the part, by identifier, before ``simulated`` were.
        simulated: identifiers of the cases that the shard simulated.
        failed: why it could not compute some.
    """
    if not part.cases:
        return build_cube(plan, results, None, (), (), (), damaged=set(plan.cases))
    damaged = {case_id for case_id, state in states.items() if state is CaseState.damaged}
    return build_cube(part, results, None, simulated, (), failed, damaged - set(simulated))


def joined_again(plan: Plan, results: Path, simulated: Collection[str], failed: Failed) -> None:
    """Write the cube and ``failures.jsonl`` after the last of several shards has ended."""
    # Others may have written both while this shard was running.
    old = previous_cube(plan, results / CUBE)
    states = survey(plan.designs, results, old, check=True)
    join(plan, results, old, states, simulated, failed)


def failure_entries(
    plan: Plan, results: Path, cube: xr.Dataset, simulated: Collection[str], failed: Failed
) -> Iterator[Failure]:
    """For every design of the cube that is not ok the reason, and the record to run it alone."""
    earlier = earlier_failures(results)
    bad = cube["status"].isin([Status.not_converged, Status.failed])
    # A case that failed when it was refreshed keeps its old results in the cube.
    for case_id in dict.fromkeys([*cube["case_id"].values[bad.values], *failed]):
        if case_id in earlier and case_id not in simulated and case_id not in failed:
            yield earlier[case_id]
        elif case := plan.cases.get(case_id):
            error = failed.get(case_id)
            yield {
                "case_id": case_id,
                **case.design,
                "status": (Status.failed if error else Status.not_converged).name,
                "reason": error.reason if error else _reason(results, case_id),
                "trace": error.trace if error else "",
                "case": case.record,
            }


def _reason(results: Path, case_id: str) -> str:
    return str(read_case(results, case_id).attrs["reason"])
