"""A results folder: its recorded plan, the state of every case, failures, and its status.

Needs no JAX.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from pydantic import BaseModel, Field, PositiveFloat, model_validator

from knitlab.cubes.case_file import StoredCase, check_case_file, read_code, stored_cases
from knitlab.cubes.cube_file import CUBE, design_dims, read_cube
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import InputError, invalid
from knitlab.io.json_file import json_table, read_json
from knitlab.io.names import Name, named_folder
from knitlab.io.provenance import MODEL, file_digests, model_of, package_digest
from knitlab.io.text_file import plain_file
from knitlab.observables.schema import RUN, Status
from knitlab.runs.workflow_file import Overrides, read_overrides, workflow_file

PLAN = "plan.json"
FAILURES = "failures.jsonl"
Design = tuple[Any, ...]
Failure = dict[str, Any]  # an entry of `failures.jsonl`: a design that is not ok, and why


class CaseRecord(BaseModel):
    """What is read of the record of a case here."""

    design: dict[str, int | float | str] = Field(min_length=1)


class GaugeRecord(BaseModel):
    """The gauge of a plan [mm]."""

    stitch_width: PositiveFloat
    stitch_height: PositiveFloat


class PlanRecord(BaseModel):
    """What is read of ``plan.json``."""

    workflow: Name
    title: str
    figures: list[str]
    dims: list[str] = Field(min_length=1)
    overrides: dict[str, Any]
    inputs: dict[str, str]
    gauge: GaugeRecord
    parameters: dict[str, Any]
    excluded: list[Annotated[list[int | float | str], Field(min_length=1)]]
    cases: dict[str, CaseRecord] = Field(min_length=1)

    @model_validator(mode="after")
    def _has_one_grid(self) -> "PlanRecord":
        if any(list(case.design) != self.dims for case in self.cases.values()):
            raise ValueError("cases have other dimensions than the plan")
        return self


class FailureRecord(BaseModel):
    """What is read of a line of ``failures.jsonl``."""

    case_id: str
    status: Literal["failed", "not_converged"]
    reason: str = Field(min_length=1)
    case: dict[str, Any] = Field(min_length=1)


class CaseState(Enum):
    """State of a planned case in a results folder."""

    done = "done"
    pending = "pending"
    stale_code = "stale: other model"
    stale_parameters = "stale: other parameters"
    damaged = "damaged"


class Cell(NamedTuple):
    """A design of a cube: its indices, its case, and the model that computed it."""

    indices: tuple[int, ...]
    case_id: str
    code: str
    status: Status

    @property
    def has_results(self) -> bool:
        """Whether it was simulated."""
        return self.status in RUN


def cells(cube: xr.Dataset | None) -> dict[Design, Cell]:
    """The designs of a cube, if there is one, by their labels, without excluded combinations."""
    if cube is None:
        return {}
    labels = [cube[dim].values.tolist() for dim in design_dims(cube)]
    case_id, code, status = (cube[name].values for name in ("case_id", "code", "status"))
    designs = {}
    for at in zip(*map(np.ndarray.tolist, np.nonzero(status != Status.excluded)), strict=True):
        design = tuple(along[k] for along, k in zip(labels, at, strict=True))
        designs[design] = Cell(
            at, str(case_id[at]), model_of(str(code[at])), Status(int(status[at]))
        )
    return designs


def survey(
    designs: Mapping[str, Design], folder: Path, known: Mapping[Design, Cell], check: bool
) -> dict[str, CaseState]:
    """State of every planned case in a folder, some of which are known from its cube.

    ``check`` compares every case file with its checksum.
    """
    listed = stored_cases(folder)

    def state(case_id: str, cell: Cell | None) -> CaseState:
        in_cube = cell is not None and cell.case_id == case_id
        if case_id not in listed:
            stale = cell is not None and not in_cube and cell.has_results
            return CaseState.stale_parameters if stale else CaseState.pending
        found = check_case_file(folder, case_id) if check else listed[case_id]
        sound = found is StoredCase.sound
        code = (cell.code if cell and in_cube else "") or (sound and read_code(folder, case_id))
        if not (sound and code):
            return CaseState.damaged
        return CaseState.done if code == MODEL else CaseState.stale_code

    return {case_id: state(case_id, known.get(design)) for case_id, design in designs.items()}


def labelled(dims: Iterable[str], design: Iterable[Any]) -> str:
    """A design as text."""
    return "  ".join(f"{name} {label}" for name, label in zip(dims, design, strict=True))


def read_plan(folder: Path) -> dict[str, Any]:
    """The record of a folder's plan."""
    path = folder / PLAN
    if not path.exists():
        raise invalid(str(path), "does not exist; plan or run the workflow first")
    return read_json(path, PlanRecord, "a plan", "plan the workflow again")


def planned_designs(record: Mapping[str, Any]) -> dict[str, Design]:
    """Labels of the cases of a recorded plan, by identifier."""
    return {case_id: tuple(case["design"].values()) for case_id, case in record["cases"].items()}


def changed_inputs(record: Mapping[str, Any]) -> tuple[str, ...]:
    """Input files of a recorded plan that have changed since it was made."""
    now = file_digests(map(Path, record["inputs"]))
    return tuple(path for path, digest in record["inputs"].items() if now.get(path) != digest)


def earlier_failures(folder: Path) -> dict[str, Failure]:
    """Entries for designs that were not ok when a run last ended, by case identifier."""
    try:
        lines = plain_file(folder / FAILURES).read_text(encoding="utf-8").splitlines()
        entries = [json_table(line, FAILURES, FailureRecord) for line in lines]
        return {entry["case_id"]: entry for entry in entries}
    except (OSError, ValueError):
        return {}  # every run rewrites the file, and no result depends on it


def without_results(failures: Mapping[str, Failure]) -> set[str]:
    """The cases among failures that could not be computed at all."""
    return {name for name, entry in failures.items() if entry["status"] == Status.failed.name}


def write_failures(folder: Path, failures: Iterable[Failure]) -> None:
    """Replace the entries for designs that are not ok."""
    with atomic_write(folder / FAILURES) as temporary:
        temporary.write_text("".join(json.dumps(entry) + "\n" for entry in failures))


@dataclass(frozen=True)
class FolderStatus:
    """The progress of the plan of a results folder; cases are named by their identifiers."""

    designs: dict[str, Design]  # labels of the planned cases along the dimensions
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
        return labelled(self.dims, self.designs[case_id])

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
        workflow: name of a shipped workflow, or path of a TOML file.
        results: folder that holds a folder of results for each workflow.
        check: whether to compare every case file with its checksum.

    Raises:
        InputError: if the workflow was never planned there.
    """
    folder = named_folder(Path(results), Path(workflow).stem)
    record = read_plan(folder)
    designs, changed = planned_designs(record), changed_inputs(record)
    if changed:
        from knitlab.runs.plan import make_plan  # imports JAX, which only this case needs

        designs = make_plan(str(workflow), record["overrides"]).designs
    return folder_status(folder, tuple(record["dims"]), designs, check, changed)


def folder_status(
    folder: Path,
    dims: tuple[str, ...],
    designs: dict[str, Design],
    check: bool,
    changed: tuple[str, ...] = (),
) -> FolderStatus:
    """Status of cases, given by their labels, in a folder; InputError if ``cube.nc`` is no cube."""
    cube = read_cube(folder / CUBE, lazily=True) if (folder / CUBE).exists() else None
    known = cells(cube)
    statuses = {}
    failures = {case_id: entry["reason"] for case_id, entry in earlier_failures(folder).items()}
    in_cube = {cell.case_id: cell.status.name for cell in known.values()}
    for case_id, state in survey(designs, folder, known, check).items():
        if state is CaseState.done:
            statuses[case_id] = in_cube.get(case_id, "done, not yet in the cube")
        elif state is CaseState.pending and case_id in failures:
            statuses[case_id] = Status.failed.name
        else:
            statuses[case_id] = state.value
    return FolderStatus(designs, dims, statuses, failures, changed)


def finished_plan(
    workflow: str, overrides: Overrides, results: Path
) -> tuple[dict[str, Any], xr.Dataset] | None:
    """The record of a plan of which a run would change nothing, and the cube; None if not."""
    with suppress(InputError, OSError):
        path = workflow_file(workflow)
        folder = results / path.stem
        record = read_plan(folder)
        if (
            record["overrides"] == {each.name: each.value for each in read_overrides(overrides)[0]}
            and record.get("package") == package_digest()
            and str(path.resolve()) in record["inputs"]
            and not changed_inputs(record)
        ):
            cube, designs = read_cube(folder, lazily=True), planned_designs(record)
            known = cells(cube)
            ok = {cell.case_id for cell in known.values() if cell.status is Status.ok}
            if designs.keys() <= ok:
                states = survey(designs, folder, known, check=True)
                return (record, cube) if set(states.values()) == {CaseState.done} else None
    return None
