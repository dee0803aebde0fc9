"""The status of the plan of a results folder, and whether a run would change anything there."""

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cubes.cube_file import read_cube
from knitlab.io.cube_path import CUBE
from knitlab.io.errors import InputError
from knitlab.io.names import named_folder
from knitlab.io.shipped import shipped
from knitlab.observables.status import Status
from knitlab.runs.recorded_plan import PLAN, changed_inputs, planned_designs, read_plan
from knitlab.runs.results_folder import (
    CaseState,
    Check,
    Labels,
    case_states,
    cube_designs,
    earlier_failures,
    label_text,
)


@dataclass(frozen=True)
class FolderStatus:
    """The progress of the plan of a results folder; cases are named by their identifiers."""

    designs: dict[str, Labels]  # labels of the planned cases along the dimensions
    dims: tuple[str, ...]
    statuses: dict[str, str]  # status of every planned case, or why it is not done
    failures: dict[str, str]  # reason of every failed case
    changed: tuple[str, ...]  # files that have changed since the plan was made

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<FolderStatus: {len(self.designs)} cases, {counts}>"

    @property
    def counts(self) -> dict[str, int]:
        """Number of cases by status, in descending order."""
        return dict(Counter(self.statuses.values()).most_common())

    def label(self, case_id: str) -> str:
        """The design of a case as text."""
        return label_text(self.dims, self.designs[case_id])

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


def status(
    workflow: str | Path, *, results: str | Path = "results", check: bool = False
) -> FolderStatus:
    """Status of the cases of the last plan of a workflow, which is renewed if its files changed.

    Args:
        workflow: name of a shipped workflow, path of a TOML file, or the folder of its results.
        results: folder that holds a folder of results for each workflow.
        check: whether to compare every case file with its checksum.

    Raises:
        InputError: if the workflow was never planned there.
    """
    folder = Path(workflow)
    if not (folder / PLAN).is_file():
        folder = named_folder(Path(results), folder.stem)
    record = read_plan(folder)
    designs, changed = planned_designs(record), changed_inputs(record)
    if changed:
        from knitlab.runs.plan import make_plan

        designs = make_plan(_workflow_of(record), record["overrides"]).designs
    return folder_status(folder, tuple(record["dims"]), designs, check, changed)


def _workflow_of(record: dict[str, Any]) -> str:
    """The file of the workflow of a recorded plan."""
    files = (Path(path) for path in record["inputs"])
    return next(
        str(path)
        for path in files
        if path.stem == record["workflow"] and path.parent != shipped("params").resolve()
    )


def folder_status(
    folder: Path,
    dims: tuple[str, ...],
    designs: dict[str, Labels],
    check: bool,
    changed: tuple[str, ...] = (),
) -> FolderStatus:
    """Status of cases, by their labels, in a folder; InputError if ``cube.nc`` is not a cube."""
    cube = read_cube(folder / CUBE, lazily=True) if (folder / CUBE).exists() else None
    known = cube_designs(cube)
    statuses = {}
    failures = {case_id: entry["reason"] for case_id, entry in earlier_failures(folder).items()}
    in_cube = {each.case_id: each.status.name for each in known.values()}
    checked = Check.all if check else Check.none
    for case_id, state in case_states(designs, folder, known, checked).items():
        if state is CaseState.done:
            statuses[case_id] = in_cube.get(case_id, "done, not yet in the cube")
        elif state is CaseState.pending and case_id in failures:
            statuses[case_id] = Status.failed.name
        else:
            statuses[case_id] = state.value
    return FolderStatus(designs, dims, statuses, failures, changed)


def finished_cube(record: Mapping[str, Any], folder: Path) -> xr.Dataset | None:
    """The cube of a recorded plan in its folder if a run would change nothing, or None."""
    with suppress(InputError, OSError):
        cube, designs = read_cube(folder, lazily=True), planned_designs(record)
        known = cube_designs(cube)
        ok = {each.case_id for each in known.values() if each.status is Status.ok}
        if designs.keys() <= ok:
            states = case_states(designs, folder, known, Check.changed)
            return cube if set(states.values()) == {CaseState.done} else None
    return None
