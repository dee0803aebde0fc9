"""What a results folder holds: its plan, cube, sound case files and failures. Needs no JAX."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cube.case_file import StoredCase, case_path, check_case_file, read_code
from knitlab.cube.common_settings import parameters_of
from knitlab.cube.cube_file import CUBE, design_dims, is_measured, open_cube
from knitlab.io.errors import fault
from knitlab.sweep.status import PLAN, earlier_failures, read_plan
from knitlab.sweep.survey import Cell, Design, cells

CASES = "cases"


@dataclass(frozen=True)
class ResultsFolder:
    """The contents of a results folder of one workflow.

    Attributes:
        path: the folder.
        record: record of its plan, if it has one.
        cube: its cube, if it has one.
        case_files: identifiers of its undamaged case files.
        damaged: its damaged case files.
    """

    path: Path
    record: Mapping[str, Any] | None
    cube: xr.Dataset | None
    case_files: frozenset[str]
    damaged: tuple[Path, ...]

    @property
    def workflow(self) -> str:
        """Name of the workflow."""
        if self.record is not None:
            return str(self.record["workflow"])
        return self.path.name if self.cube is None else str(self.cube.attrs["workflow"])

    @cached_property
    def cells(self) -> dict[Design, Cell]:
        """The designs of its cube."""
        return {} if self.cube is None else cells(self.cube)

    @cached_property
    def failures(self) -> dict[str, dict[str, Any]]:
        """Why designs are not ok, by case identifier."""
        return earlier_failures(self.path)

    @property
    def dims(self) -> tuple[str, ...] | None:
        """Dimensions of its designs."""
        if self.cube is not None:
            return design_dims(self.cube)
        return None if self.record is None else tuple(self.record["dims"])

    @property
    def parameters(self) -> dict[str, Any]:
        """The settings that its designs share."""
        if self.cube is not None:
            return parameters_of(self.cube)
        return {} if self.record is None else dict(self.record.get("parameters", {}))

    @cached_property
    def codes(self) -> dict[str, str]:
        """Fingerprint of the code that computed each case with results, by identifier."""
        known = {cell.case_id: cell.code for cell in self.cells.values() if cell.has_results}
        unread = self.case_files - known.keys()
        return known | {case_id: read_code(self.path, case_id) or "" for case_id in unread}


def read_folder(path: Path) -> ResultsFolder:
    """Read a results folder.

    Raises:
        BadInput: if its plan or cube cannot be read, or the cube is of an experiment.
    """
    cube = open_cube(path) if (path / CUBE).exists() else None
    if cube is not None and is_measured(cube):
        raise fault(str(path), "holds an experiment; only simulations are merged")
    checked = {file.stem: check_case_file(path, file.stem) for file in (path / CASES).glob("*.nc")}
    return ResultsFolder(
        path,
        read_plan(path) if (path / PLAN).exists() else None,
        cube,
        frozenset(name for name, state in checked.items() if state is StoredCase.sound),
        tuple(case_path(path, name) for name, its in checked.items() if its is StoredCase.damaged),
    )


def results_folders(path: Path, *, missing_ok: bool = False) -> list[Path]:
    """The folder, if it holds results of a workflow; else those of its subfolders that do.

    Args:
        path: a results folder of a workflow, or a folder of such folders.
        missing_ok: whether to return nothing, and not look into subfolders, if it holds none.

    Raises:
        BadInput: if there are none.
    """
    if _holds_results(path):
        return [path]
    if missing_ok:
        return []
    found = sorted(each for each in path.glob("*") if each.is_dir() and _holds_results(each))
    if not found:
        raise fault(str(path), f"holds no results: neither {PLAN} nor {CUBE}; check the path")
    return found


def _holds_results(path: Path) -> bool:
    return any((path / name).exists() for name in (PLAN, CUBE, CASES))
