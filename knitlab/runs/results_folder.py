"""A results folder: the state of every case, and its failures. Needs no JAX."""

import json
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import (
    case_path,
    is_undamaged,
    read_code,
    read_values,
    stored_cases,
)
from knitlab.cubes.cube_file import design_dims
from knitlab.io.atomic_write import atomic_write
from knitlab.io.cube_path import CUBE
from knitlab.io.provenance import MODEL, stored_model
from knitlab.observables.status import RUN, Status
from knitlab.runs.recorded_plan import Labels

FAILURES = "failures.jsonl"
Failure = dict[str, Any]  # an entry of `failures.jsonl`: a design that is not ok, and why


class CaseState(Enum):
    """State of a planned case in a results folder."""

    done = "done"
    pending = "pending"
    stale_code = "stale: other model"
    stale_parameters = "stale: other parameters"
    damaged = "damaged"


class Check(Enum):
    """Which case files are compared with their checksums."""

    none = "none"
    changed = "those that changed since the cube was written, or have no results in it"
    all = "all"


class CubeDesign(NamedTuple):
    """A design of a cube: its indices, its case, and the model that computed it."""

    indices: tuple[int, ...]
    case_id: str
    code: str
    status: Status

    @property
    def has_results(self) -> bool:
        """Whether it was simulated."""
        return self.status in RUN


def cube_designs(cube: xr.Dataset | None) -> dict[Labels, CubeDesign]:
    """The designs of a cube, if there is one, by their labels, without excluded combinations."""
    if cube is None:
        return {}
    labels = [cube[dim].values.tolist() for dim in design_dims(cube)]
    case_id, code, status = (cube[name].values for name in ("case_id", "code", "status"))
    designs = {}
    for row in np.argwhere(status != Status.excluded).tolist():
        at, model = tuple(row), stored_model(str(code[*row]))
        design = tuple(along[k] for along, k in zip(labels, at, strict=True))
        designs[design] = CubeDesign(at, str(case_id[at]), model, Status(int(status[at])))
    return designs


def doubt(folder: Path, cases: Iterable[str]) -> None:
    """Make some case files newer than the cube, so that the next run checks them."""
    for case_id in cases:
        case_path(folder, case_id).touch()


def stored_statuses(folder: Path, cases: Iterable[str]) -> dict[str, Status]:
    """Statuses in the files of those cases that have one."""
    files = stored_cases(folder)
    paths = {case_id: case_path(folder, case_id) for case_id in cases if case_id in files}
    return {name: Status(read_values(path, ["status"])["status"]) for name, path in paths.items()}


def case_states(
    designs: Mapping[str, Labels],
    folder: Path,
    known: Mapping[Labels, CubeDesign],
    check: Check,
) -> dict[str, CaseState]:
    """State of every planned case."""
    files, states, cube = stored_cases(folder), {}, folder / CUBE
    # Before the cube was written, all its case files were checked.
    since = cube.stat().st_mtime if check is Check.changed and cube.exists() else 0.0
    for case_id, labels in designs.items():
        design = known.get(labels)
        is_in_cube = design is not None and design.case_id == case_id
        has_results = design is not None and design.has_results
        unchanged = is_in_cube and has_results and files.get(case_id, since) < since
        if case_id not in files:
            is_stale = has_results and not is_in_cube
            states[case_id] = CaseState.stale_parameters if is_stale else CaseState.pending
        elif check is not Check.none and not unchanged and not is_undamaged(folder, case_id):
            states[case_id] = CaseState.damaged
        else:
            code = design.code if design and is_in_cube else ""
            code = code or read_code(folder, case_id)
            if not code:
                states[case_id] = CaseState.damaged
            else:
                states[case_id] = CaseState.done if code == MODEL else CaseState.stale_code
    return states


def label_text(dims: Iterable[str], design: Iterable[Any]) -> str:
    """A design as text."""
    return "  ".join(f"{name} {label}" for name, label in zip(dims, design, strict=False))


def earlier_failures(folder: Path) -> dict[str, Failure]:
    """Entries for designs that were not ok when a run last ended, by case identifier."""
    try:
        lines = (folder / FAILURES).read_text(encoding="utf-8").splitlines()
        return {entry["case_id"]: entry for entry in map(json.loads, lines) if entry}
    except (OSError, ValueError):
        return {}  # every run rewrites the file, and no result depends on it


def failed_cases(failures: Mapping[str, Failure]) -> set[str]:
    """The cases among failures that could not be computed at all."""
    return {name for name, entry in failures.items() if entry["status"] == Status.failed.name}


def write_failures(folder: Path, failures: Iterable[Failure]) -> None:
    """Replace the entries for designs that are not ok."""
    with atomic_write(folder / FAILURES) as temporary:
        lines = "".join(json.dumps(entry) + "\n" for entry in failures)
        temporary.write_text(lines, encoding="utf-8")
