"""Merging: results folders of one workflow become one, unless they contradict each other."""

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cube.case_file import case_path, checksum_path
from knitlab.cube.cube_file import CUBE, joined_cubes, write_cube
from knitlab.cube.schema import Status
from knitlab.io.atomic_write import atomic_write, clear_unfinished
from knitlab.io.errors import fault
from knitlab.io.lock import held
from knitlab.sweep.agreement import check_agreement
from knitlab.sweep.cube import build_cube
from knitlab.sweep.results_folder import ResultsFolder, read_folder, results_folders
from knitlab.sweep.status import FAILURES, PLAN, planned_designs
from knitlab.sweep.stored_plan import joined_plan
from knitlab.sweep.survey import CaseState, Design, cells, survey

Failure = dict[str, Any]


@dataclass(frozen=True)
class Merge:
    """The result of a merge.

    Attributes:
        folder: the results folder that was merged into.
        cube: its cube, as written.
        sources: the folders that were merged into it.
        copied: identifiers of the case files that it did not have.
        damaged: damaged case files of the sources, which are left out.
    """

    folder: Path
    cube: xr.Dataset
    sources: tuple[Path, ...]
    copied: tuple[str, ...]
    damaged: tuple[Path, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Number of designs by status, without excluded combinations."""
        found = self.cube["status"].values
        numbers = {status.name: int((found == status).sum()) for status in Status}
        return {name: n for name, n in numbers.items() if n and name != Status.excluded.name}


def merge_folders(folders: Sequence[Path], results: Path, *, any_code: bool = False) -> Merge:
    """Join the case files, cubes, plans and failures of several results folders.

    Everything is compared before anything is written; then case files are copied and the cube is
    replaced, each atomically. The sources are not changed, and merging again changes nothing.

    Args:
        folders: results folders of one workflow, or folders that hold one.
        results: folder that holds a folder of results for each workflow; what the workflow has
            there already is kept.
        any_code: whether results of different code may be joined.

    Raises:
        BadInput: if the folders contradict each other or hold several workflows; the message names
            what differs.
        CannotWrite: if the merged folder cannot be written.
    """
    paths = list(
        dict.fromkeys(path.resolve() for each in folders for path in results_folders(each))
    )
    sources = [read_folder(path) for path in paths]
    names = {source.workflow: source.path for source in sources}
    if len(names) > 1:
        listed = ", ".join(f"{name} in {path}" for name, path in names.items())
        raise fault("folders", f"hold results of several workflows ({listed}); merge one at a time")
    target = results / next(iter(names))
    with held(target):
        clear_unfinished(target)
        merged = [source for source in sources if source.path != target.resolve()]
        if results_folders(target, missing_ok=True):
            merged = [read_folder(target), *merged]
        check_agreement(merged, any_code=any_code)
        copied = tuple(_copied(merged, target))
        records = [source.record for source in merged if source.record]
        cube = _cube(merged, records, target)
        _write_plan(merged, records, target)
        write_cube(cube, target / CUBE)
        with atomic_write(target / FAILURES) as temporary:
            lines = (json.dumps(entry) + "\n" for entry in _failures(merged, cube))
            temporary.write_text("".join(lines))
    damaged = {path for source in sources for path in source.damaged}
    whole = {case_id for source in merged for case_id in source.case_files}
    missing = tuple(sorted(path for path in damaged if path.stem not in whole))
    return Merge(target, cube, tuple(source.path for source in sources), copied, missing)


def _copied(merged: Sequence[ResultsFolder], target: Path) -> Iterator[str]:
    """Copy the case files that the target lacks; yields their identifiers."""
    sound = {case_id: source for source in reversed(merged) for case_id in source.case_files}
    for case_id, source in sorted(sound.items()):
        if source.path == target.resolve():
            continue
        # The checksum first, as where a case is simulated.
        for path in (checksum_path, case_path):
            with atomic_write(path(target, case_id)) as temporary:
                shutil.copyfile(path(source.path, case_id), temporary)
        yield case_id


def _cube(
    merged: Sequence[ResultsFolder], records: Sequence[Mapping[str, Any]], target: Path
) -> xr.Dataset:
    """The cube of all folders, with the case files that are in none of their cubes."""
    cubes = [source.cube for source in merged if source.cube is not None]
    joined = joined_cubes(cubes) if cubes else None
    designs: dict[str, Design] = {}
    for record in records:
        designs |= planned_designs(record)
    stored = {} if joined is None else cells(joined)
    states = survey(designs, target, joined, check=False)
    done = {
        case_id
        for case_id, design in designs.items()
        if (cell := stored.get(design)) and cell.case_id == case_id and cell.has_results
    }
    unread = [
        case_id
        for case_id, state in states.items()
        if case_id not in done
        and (designs[case_id] not in stored or state in (CaseState.done, CaseState.stale_code))
    ]
    if joined is not None and not unread:
        return joined
    if not records:
        path = merged[0].path
        raise fault(str(path), f"has neither {PLAN} nor {CUBE}; run its workflow there first")
    failed = {
        case_id
        for source in merged
        for case_id, entry in source.failures.items()
        if entry["status"] == Status.failed.name and case_id not in done
    }
    return build_cube(
        joined_plan(records, str(target)),
        target,
        joined,
        computed=(),
        kept_stale=[name for name, its in states.items() if its is CaseState.stale_parameters],
        failed={name for name in failed if states.get(name) is CaseState.pending},
        damaged=[name for name, its in states.items() if its is CaseState.damaged],
    )


def _write_plan(
    merged: Sequence[ResultsFolder], records: Sequence[Mapping[str, Any]], target: Path
) -> None:
    """Write the plan with the cases of all plans, unless the target has it."""
    if not records or (
        merged[0].path == target.resolve()
        and merged[0].record
        and all(record["cases"].keys() <= merged[0].record["cases"].keys() for record in records)
    ):
        return
    first = next(source.path for source in merged if source.record)
    if all(record["cases"].keys() == records[0]["cases"].keys() for record in records):
        with atomic_write(target / PLAN) as temporary:
            shutil.copyfile(first / PLAN, temporary)
    else:
        joined_plan(records, str(target)).write(target / PLAN)


def _failures(merged: Sequence[ResultsFolder], cube: xr.Dataset) -> Iterator[Failure]:
    """Why designs of the merged cube are not ok, as far as a folder says it."""
    found: dict[str, Failure] = {}
    for source in reversed(merged):
        found |= source.failures
    bad = cube["status"].isin([Status.not_converged, Status.failed]).values
    for case_id in cube["case_id"].values[bad].tolist():
        if case_id in found:
            yield found[case_id]
