"""The survey: the state of every case of a plan in a results folder. Needs no JAX."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.case_file import StoredCase, case_path, check_case_file, checksum_path, read_code
from knitlab.cube.cube_file import design_dims
from knitlab.cube.schema import Status
from knitlab.io.errors import fault
from knitlab.io.fingerprint import code_fingerprint

Design = tuple[Any, ...]


class CaseState(Enum):
    """State of a planned case in a results folder."""

    done = "done"
    pending = "pending"
    stale_code = "stale: other code"
    stale_parameters = "stale: other parameters"
    damaged = "damaged"

    @property
    def stale(self) -> bool:
        """Whether the results are of other code or parameters."""
        return self in (CaseState.stale_code, CaseState.stale_parameters)


@dataclass(frozen=True)
class Cell:
    """A design of a cube.

    Attributes:
        place: its index in the cube, one for each design dimension.
        case_id: identifier of its case.
        code: fingerprint of the code that computed it.
        status: its status.
    """

    place: tuple[int, ...]
    case_id: str
    code: str
    status: Status

    @property
    def has_results(self) -> bool:
        """Whether it was simulated."""
        return self.status in (Status.ok, Status.not_converged)


def cells(cube: xr.Dataset) -> dict[Design, Cell]:
    """The designs of a cube by their labels, without excluded combinations."""
    labels = [cube[dim].values.tolist() for dim in design_dims(cube)]
    status, case_id = cube["status"].values, cube["case_id"].values
    # Cubes of earlier versions have no code.
    code = cube["code"].values if "code" in cube else np.full(status.shape, "")
    found = {}
    for place in zip(*map(np.ndarray.tolist, np.nonzero(status != Status.excluded)), strict=True):
        design = tuple(along[k] for along, k in zip(labels, place, strict=True))
        found[design] = Cell(
            place, str(case_id[place]), str(code[place]), Status(int(status[place]))
        )
    return found


def check_dims(cube: xr.Dataset, dims: tuple[str, ...], path: Path) -> None:
    """Check that a cube has the dimensions of a plan.

    Raises:
        BadInput: if it has others.
    """
    if design_dims(cube) != dims:
        raise fault(
            str(path),
            f"has the dimensions {', '.join(design_dims(cube))}, but the workflow has"
            f" {', '.join(dims)}; name another results folder",
        )


def survey(
    cases: Mapping[str, Design], folder: Path, cube: xr.Dataset | None, check: bool
) -> dict[str, CaseState]:
    """State of every planned case, by identifier.

    Args:
        cases: designs by case identifier.
        folder: results folder of the workflow.
        cube: its cube, if there is one.
        check: whether to compare every case file with its checksum, rather than only test that
            both files exist.
    """
    stored = {} if cube is None else cells(cube)
    names = {path.name for path in (folder / "cases").glob("*")}
    return dict(_survey(cases, folder, stored, names, check))


def _survey(
    cases: Mapping[str, Design],
    folder: Path,
    stored: Mapping[Design, Cell],
    names: set[str],
    check: bool,
) -> Iterator[tuple[str, CaseState]]:
    for case_id, design in cases.items():
        cell = stored.get(design)
        result, checksum = case_path(folder, case_id).name, checksum_path(folder, case_id).name
        if result not in names:
            stale = cell is not None and cell.case_id != case_id and cell.has_results
            yield case_id, CaseState.stale_parameters if stale else CaseState.pending
        elif checksum not in names or (
            check and check_case_file(folder, case_id) is not StoredCase.sound
        ):
            yield case_id, CaseState.damaged
        else:
            if cell is not None and cell.case_id == case_id and cell.code:
                code: str | None = cell.code
            else:
                code = read_code(folder, case_id)
            if code is None:
                yield case_id, CaseState.damaged
            else:
                current = code == code_fingerprint()
                yield case_id, CaseState.done if current else CaseState.stale_code
