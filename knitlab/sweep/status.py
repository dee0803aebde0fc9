"""The status of a results folder: which cases are done, pending or stale. Needs no JAX."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knitlab.cube.cube_file import CUBE, open_cube
from knitlab.cube.schema import Status
from knitlab.io.errors import fault
from knitlab.io.fingerprint import code_fingerprint, digests
from knitlab.sweep.shard_record import read_records
from knitlab.sweep.survey import CaseState, Design, cells, survey

if TYPE_CHECKING:
    from knitlab.sweep.plan import Plan  # imports JAX

PLAN = "plan.json"
FAILURES = "failures.jsonl"


@dataclass(frozen=True)
class FolderStatus:
    """The progress of the plan of a results folder.

    Attributes:
        designs: labels of the planned cases, by identifier.
        dims: dimensions of the labels.
        statuses: status of every planned case, or why it is not done, by identifier.
        failures: reason of every failed case, by identifier.
        changed: files that have changed since the plan was made.
    """

    designs: dict[str, Design]
    dims: tuple[str, ...]
    statuses: dict[str, str]
    failures: dict[str, str]
    changed: tuple[str, ...]

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<FolderStatus: {len(self.designs)} cases, {counts}>"

    @property
    def counts(self) -> dict[str, int]:
        """Number of cases by status, in descending order."""
        return dict(Counter(self.statuses.values()).most_common())

    def label(self, case_id: str) -> str:
        """The design of a case as text."""
        labels = zip(self.dims, self.designs[case_id], strict=True)
        return "  ".join(f"{name} {value}" for name, value in labels)

    def record(self) -> dict[str, Any]:
        """The status as a JSON object."""
        return {
            "cases": len(self.designs),
            "counts": self.counts,
            "changed_inputs": self.changed,
            "not_ok": [
                {
                    "case_id": case_id,
                    **dict(zip(self.dims, self.designs[case_id], strict=True)),
                    "status": status,
                    "reason": self.failures.get(case_id, ""),
                }
                for case_id, status in self.statuses.items()
                if status != Status.ok.name
            ],
        }


def read_plan(folder: Path) -> dict[str, Any]:
    """The record of a folder's plan.

    Raises:
        BadInput: if there is none.
    """
    path = folder / PLAN
    try:
        record = json.loads(path.read_text())
        complete = all(name in record for name in ("cases", "dims", "inputs", "overrides"))
    except FileNotFoundError:
        raise fault(str(path), "does not exist; plan or run the workflow first") from None
    except OSError as error:
        raise fault(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except (ValueError, TypeError):
        complete = False
    if not complete:
        raise fault(str(path), "is not a plan; plan the workflow again")
    return dict(record)


def changed_inputs(record: Mapping[str, Any]) -> tuple[str, ...]:
    """Input files of a plan that have changed since it was made."""
    now = digests(map(Path, record["inputs"]))
    return tuple(path for path, digest in record["inputs"].items() if now.get(path) != digest)


def workflow_status(workflow: str, results: Path, check: bool) -> FolderStatus:
    """Progress of the last plan of a workflow.

    If an input file of the plan has changed, the workflow is planned again.

    Args:
        workflow: name of the workflow, or path of its file.
        results: folder that holds a folder of results for each workflow.
        check: whether to compare case files with their checksums.

    Raises:
        BadInput: if the workflow was never planned there.
    """
    folder = results / Path(workflow).stem
    record = read_plan(folder)
    designs = planned_designs(record)
    if changed_inputs(record):
        from knitlab.sweep.plan import make_plan  # imports JAX, which only this case needs

        designs = make_plan(workflow, tuple(record["overrides"])).designs
    return folder_status(folder, record, designs, check)


def folder_status(
    folder: Path, record: Mapping[str, Any], designs: Mapping[str, Design], check: bool
) -> FolderStatus:
    """Status of every planned case in a results folder.

    Args:
        folder: the folder.
        record: record of its plan, see :func:`read_plan`.
        designs: labels of the planned cases, by identifier.
        check: whether to compare case files with their checksums.

    Raises:
        BadInput: if its ``cube.nc`` is not a cube.
    """
    cube = open_cube(folder / CUBE, lazily=True) if (folder / CUBE).exists() else None
    stored = {} if cube is None else cells(cube)
    failures = earlier_failures(folder)
    statuses = {}
    for case_id, state in survey(designs, folder, cube, check).items():
        cell = stored.get(designs[case_id])
        if state is CaseState.done:
            in_cube = cell is not None and cell.case_id == case_id
            statuses[case_id] = (
                cell.status.name if cell and in_cube else "done, not yet in the cube"
            )
        elif state is CaseState.pending and case_id in failures:
            statuses[case_id] = Status.failed.name
        else:
            statuses[case_id] = state.value
    return FolderStatus(
        designs=dict(designs),
        dims=tuple(record["dims"]),
        statuses=statuses,
        failures={case_id: entry["reason"] for case_id, entry in failures.items()},
        changed=changed_inputs(record),
    )


def planned_designs(record: Mapping[str, Any]) -> dict[str, Design]:
    """Labels of a plan's cases, by identifier."""
    return {case_id: tuple(case["design"].values()) for case_id, case in record["cases"].items()}


def check_same_plan(plan: "Plan", folder: Path) -> None:
    """Check that a folder's plan has the cases of a plan that is to be added to it.

    Raises:
        BadInput: if it has others.
    """
    record = read_plan(folder)
    if (set(record["cases"]), record.get("code")) != (set(plan.cases), code_fingerprint()):
        raise fault(
            str(folder / PLAN),
            "is that of the shards that run in this folder, and has other cases or was made by"
            " other code; wait for them, or name another results folder",
        )


def earlier_failures(folder: Path) -> dict[str, dict[str, Any]]:
    """Entries for designs that are not ok, by case identifier: of the last run, and of shards."""
    try:
        lines = (folder / FAILURES).read_text().splitlines()
        last = [json.loads(line) for line in lines]
        found = {entry["case_id"]: entry for entry in last if entry["reason"] and entry["case"]}
    except (OSError, ValueError, TypeError, KeyError):
        found = {}  # every run rewrites the file, and no result depends on it
    for record in read_records(folder):
        found |= {entry["case_id"]: entry for entry in record.failures}
    return found
