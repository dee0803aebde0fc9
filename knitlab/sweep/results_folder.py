"""What a results folder holds of a plan: its record, the state of every case, and why some failed.

Needs no JAX.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.case_file import StoredCase, case_path, check_case_file, checksum_path, read_code
from knitlab.cube.cube_file import design_dims
from knitlab.cube.schema import RUN, Status
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import fault
from knitlab.io.fingerprint import code_fingerprint, digests

PLAN = "plan.json"
FAILURES = "failures.jsonl"
Design = tuple[Any, ...]
Failure = dict[str, Any]
"""An entry of ``failures.jsonl``: a design that is not ok, and why."""


class CaseState(Enum):
    """State of a planned case in a results folder."""

    done = "done"
    pending = "pending"
    stale_code = "stale: other code"
    stale_parameters = "stale: other parameters"
    damaged = "damaged"


@dataclass(frozen=True)
class Cell:
    """A design of a cube: its indices, its case, and the fingerprint of the code behind it."""

    place: tuple[int, ...]
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
    status, case_id, code = (cube[name].values for name in ("status", "case_id", "code"))
    found = {}
    for place in zip(*map(np.ndarray.tolist, np.nonzero(status != Status.excluded)), strict=True):
        design = tuple(along[k] for along, k in zip(labels, place, strict=True))
        found[design] = Cell(
            place, str(case_id[place]), str(code[place]), Status(int(status[place]))
        )
    return found


def survey(
    designs: Mapping[str, Design], folder: Path, stored: Mapping[Design, Cell], check: bool
) -> dict[str, CaseState]:
    """State of every planned case in a folder; ``check`` compares case files with checksums."""
    names = {path.name for path in (folder / "cases").glob("*")}
    states = {}
    for case_id, design in designs.items():
        cell = stored.get(design)
        same = cell is not None and cell.case_id == case_id
        if case_path(folder, case_id).name not in names:
            stale = cell is not None and not same and cell.has_results
            states[case_id] = CaseState.stale_parameters if stale else CaseState.pending
            continue
        code = None
        if checksum_path(folder, case_id).name in names and not (
            check and check_case_file(folder, case_id) is not StoredCase.sound
        ):
            code = cell.code if cell and same and cell.code else read_code(folder, case_id)
        if code is None:
            states[case_id] = CaseState.damaged
        else:
            current = code == code_fingerprint()
            states[case_id] = CaseState.done if current else CaseState.stale_code
    return states


def read_plan(folder: Path) -> dict[str, Any]:
    """The record of a folder's plan."""
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


def planned_designs(record: Mapping[str, Any]) -> dict[str, Design]:
    """Labels of the cases of a recorded plan, by identifier."""
    return {case_id: tuple(case["design"].values()) for case_id, case in record["cases"].items()}


def changed_inputs(record: Mapping[str, Any]) -> tuple[str, ...]:
    """Input files of a recorded plan that have changed since it was made."""
    now = digests(map(Path, record["inputs"]))
    return tuple(path for path, digest in record["inputs"].items() if now.get(path) != digest)


def earlier_failures(folder: Path) -> dict[str, Failure]:
    """Entries for designs that were not ok when a run last ended, by case identifier."""
    try:
        entries = [json.loads(line) for line in (folder / FAILURES).read_text().splitlines()]
        return {entry["case_id"]: entry for entry in entries if entry["reason"] and entry["case"]}
    except (OSError, ValueError, TypeError, KeyError):
        return {}  # every run rewrites the file, and no result depends on it


def write_failures(folder: Path, failures: Iterable[Failure]) -> None:
    """Replace the entries for designs that are not ok."""
    with atomic_write(folder / FAILURES) as temporary:
        temporary.write_text("".join(json.dumps(entry) + "\n" for entry in failures))
