"""The status of a sweep: which cases are done, pending or stale, and whether a run is complete.

Needs no JAX.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knitlab.cube.cube_file import CUBE, open_cube
from knitlab.cube.schema import Status
from knitlab.io.errors import BadInput
from knitlab.io.fingerprint import package_fingerprint
from knitlab.sweep.results_folder import (
    CaseState,
    Design,
    cells,
    changed_inputs,
    earlier_failures,
    planned_designs,
    read_plan,
    survey,
)
from knitlab.sweep.workflow_file import Overrides, read_overrides, workflow_file


@dataclass(frozen=True)
class FolderStatus:
    """The progress of the plan of a results folder; cases are named by their identifiers.

    Attributes:
        designs: labels of the planned cases along the dimensions.
        statuses: status of every planned case, or why it is not done.
        failures: reason of every failed case.
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


def workflow_status(workflow: str, results: Path, check: bool) -> FolderStatus:
    """Progress of the last plan of a workflow, which is planned again if an input has changed.

    BadInput if it was never planned there; ``check`` compares every case file with its checksum.
    """
    folder = results / Path(workflow).stem
    record = read_plan(folder)
    designs = planned_designs(record)
    if changed_inputs(record):
        from knitlab.sweep.plan import make_plan  # imports JAX, which only this case needs

        designs = make_plan(workflow, record["overrides"]).designs
    return folder_status(folder, record, designs, check)


def folder_status(
    folder: Path, record: Mapping[str, Any], designs: Mapping[str, Design], check: bool
) -> FolderStatus:
    """Status of cases, given by their labels, in a folder; BadInput if ``cube.nc`` is no cube."""
    cube = open_cube(folder / CUBE, lazily=True) if (folder / CUBE).exists() else None
    stored = cells(cube)
    failures = earlier_failures(folder)
    statuses = {}
    for case_id, state in survey(designs, folder, stored, check).items():
        cell = stored.get(designs[case_id])
        if state is CaseState.done:
            in_cube = cell if cell and cell.case_id == case_id else None
            statuses[case_id] = in_cube.status.name if in_cube else "done, not yet in the cube"
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


def finished_plan(workflow: str, overrides: Overrides, results: Path) -> dict[str, Any] | None:
    """The record of a plan of which a run would change nothing; None if there is none."""
    try:
        path = workflow_file(workflow)
        folder = results / path.stem
        record = read_plan(folder)
        if (
            record["overrides"] == {each.name: each.value for each in read_overrides(overrides)[0]}
            and record.get("package") == package_fingerprint()
            and str(path.resolve()) in record["inputs"]
            and not changed_inputs(record)
        ):
            status = folder_status(folder, record, planned_designs(record), check=True)
            return record if set(status.counts) == {Status.ok.name} else None
    except (BadInput, OSError):
        pass
    return None
