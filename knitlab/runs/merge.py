"""Merging: results folders of one workflow become one, unless they contradict each other."""

import filecmp
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from knitlab.cubes import case_file, cube_file
from knitlab.cubes.common_settings import differences
from knitlab.cubes.cube_file import parameters_of
from knitlab.io.atomic_write import clear_unfinished
from knitlab.io.cube_path import CUBE
from knitlab.io.errors import Mistake, invalid, raise_if_any
from knitlab.io.limits import MAX_CASES_NAMED
from knitlab.io.lock import locked
from knitlab.io.names import named_folder
from knitlab.observables.status import Status
from knitlab.runs import results_folder
from knitlab.runs.cube import (
    GAUGE_ATTRIBUTES,
    MAY_DIFFER,
    build_cube,
    joined_cubes,
    owners,
    validated_cube,
)
from knitlab.runs.plan import joined_plan
from knitlab.runs.recorded_plan import PLAN, read_plan
from knitlab.runs.reproduce import CURVES, comparison
from knitlab.runs.results_folder import CubeDesign, Failure, Labels


class Merge(NamedTuple):
    """The result of a merge."""

    folder: Path
    cube: xr.Dataset
    counts: dict[str, int]  # of designs by status, without excluded combinations
    sources: tuple[Path, ...]
    copied: tuple[str, ...]  # cases whose files were copied
    damaged: tuple[Path, ...]  # files that were left out


@dataclass(frozen=True)
class FolderContents:
    """What a results folder of one workflow holds: plan, cube, and case files by their state."""

    path: Path
    workflow: str
    record: Mapping[str, Any] | None
    cube: xr.Dataset | None
    dims: tuple[str, ...]  # of its designs; empty if it states none
    parameters: dict[str, Any]  # settings that its designs share, and its gauge
    designs: dict[Labels, CubeDesign]  # of its cube, with results
    undamaged: frozenset[str]  # cases
    damaged: tuple[Path, ...]

    @classmethod
    def read(cls, path: Path, others: Sequence["FolderContents"]) -> "FolderContents":
        """Read a results folder after others; InputError if it holds an experiment."""
        workflow, dims, parameters = path.name, tuple[str, ...](), dict[str, Any]()
        cube = cube_file.read_cube(path, lazily=True) if (path / CUBE).exists() else None
        if cube is not None:
            if cube_file.is_measured(cube):
                raise invalid(str(path), "holds an experiment; only simulations are merged")
            cube = validated_cube(cube, path / CUBE)
            workflow, dims = str(cube.attrs.get("workflow", workflow)), cube_file.design_dims(cube)
            gauge = {name: cube.attrs.get(name) for name in GAUGE_ATTRIBUTES.values()}
            parameters = parameters_of(cube) | gauge
        record = read_plan(path) if (path / PLAN).exists() else None
        if record is not None:
            workflow = record["workflow"]
            dims, parameters = dims or tuple(record["dims"]), parameters or record["parameters"]
            for other in others:  # shards have one plan, which may take a gigabyte
                if other.record is not None and other.record["cases"] == record["cases"]:
                    record["cases"] = other.record["cases"]
        known = results_folder.cube_designs(cube).items()
        designs = {labels: design for labels, design in known if design.has_results}
        names = {*case_file.stored_cases(path)}
        undamaged = frozenset(name for name in names if case_file.is_undamaged(path, name))
        damaged = tuple(case_file.case_path(path, name) for name in sorted(names - undamaged))
        return cls(path, workflow, record, cube, dims, parameters, designs, undamaged, damaged)

    @cached_property
    def results(self) -> dict[str, CubeDesign | None]:
        """The cases that it has results of, with their designs if they are in its cube."""
        in_cube = {design.case_id: design for design in self.designs.values()}
        return dict.fromkeys(self.undamaged) | in_cube

    def model(self, case_id: str) -> str:
        """The model that computed a case."""
        design = self.results[case_id]
        return design.code if design else case_file.read_code(self.path, case_id)

    def numbers(self, case_id: str) -> xr.Dataset:
        """What is compared of a case: from its file, or else from the cube."""
        design = self.results[case_id]
        if design is None or self.cube is None or case_id in self.undamaged:
            case = case_file.read_case(self.path, case_id)
        else:
            case = self.cube.isel(dict(zip(self.dims, design.indices, strict=True)), drop=True)
        return case[[name for name in CURVES if name in case]]


def merge_folders(folders: Sequence[Path], results: Path, *, any_code: bool = False) -> Merge:
    """Join the files of several folders, see :func:`knitlab.merge`; all is compared before."""
    paths = dict.fromkeys(path.resolve() for each in folders for path in _results_folders(each))
    sources = list[FolderContents]()
    for path in paths:
        sources.append(FolderContents.read(path, sources))
    names = {source.workflow: source.path for source in sources}
    if len(names) > 1:
        listed = ", ".join(f"{name} in {path}" for name, path in names.items())
        message = f"hold results of several workflows ({listed}); merge one at a time"
        raise invalid("folders", message)
    target = named_folder(results, next(iter(names))).resolve()
    with locked(target):
        clear_unfinished(target)
        merged = [source for source in sources if source.path != target]
        if _holds_results(target):
            merged = [FolderContents.read(target, merged), *merged]
        _check_agreement(merged, any_code)
        failures: dict[str, Failure] = {}
        owners: dict[str, Path] = {}
        for source in reversed(merged):
            failures |= results_folder.earlier_failures(source.path)
            owners |= dict.fromkeys(source.undamaged, source.path)
        copied = {case_id: owner for case_id, owner in sorted(owners.items()) if owner != target}
        for case_id, owner in copied.items():
            case_file.copy_case_file(owner, target, case_id)
        cubes = [source.cube for source in merged if source.cube is not None]
        cube = cube_file.write_cube(_joined(merged, target, failures), target / CUBE, cubes)
        damaged = {file for source in sources for file in source.damaged if file.stem not in owners}
        left = (file.stem for file in damaged if file == case_file.case_path(target, file.stem))
        results_folder.doubt(target, left)
        bad = cube["status"].isin([Status.not_converged, Status.failed]).values
        not_ok = [failures[name] for name in cube["case_id"].values[bad] if name in failures]
        results_folder.write_failures(target, not_ok)
    counts = {each.name: int((cube["status"] == each).sum()) for each in Status}
    return Merge(
        folder=results / target.name,
        cube=cube,
        counts={name: n for name, n in counts.items() if n and name != Status.excluded.name},
        sources=tuple(paths),
        copied=tuple(copied),
        damaged=tuple(sorted(damaged)),
    )


def _results_folders(path: Path) -> list[Path]:
    """A results folder of a workflow, or those in a folder of such folders."""
    folders = [path] if _holds_results(path) else [*filter(_holds_results, sorted(path.glob("*")))]
    if not folders:
        raise invalid(str(path), f"holds no results: neither {PLAN} nor {CUBE}; check the path")
    return folders


def _holds_results(path: Path) -> bool:
    return any((path / name).exists() for name in (PLAN, CUBE, "cases"))


def _joined(
    merged: Sequence[FolderContents], target: Path, failures: Mapping[str, Failure]
) -> xr.Dataset:
    """The cube of all folders and of the case files in the target, which gets their joint plan."""
    cubes = [source.cube for source in merged if source.cube is not None]
    records = [source.record for source in merged if source.record]
    if not records:
        if not cubes:
            path = merged[0].path
            raise invalid(str(path), f"has neither {PLAN} nor {CUBE}; run its workflow there first")
        return joined_cubes(cubes)
    plan = joined_plan(records, str(target))
    plan.write(target / PLAN)
    known = {labels: owner.design for labels, owner in owners(cubes).items()}
    states = results_folder.case_states(plan.designs, target, known, results_folder.Check.none)
    return build_cube(plan, target, cubes, states, results_folder.failed_cases(failures))


def _check_agreement(folders: Sequence[FolderContents], any_code: bool) -> None:
    """Refuse folders that differ in dimensions, settings, gauges, models or results."""
    first, *others = folders
    mistakes: list[Mistake] = []
    for other in others:
        if first.dims and other.dims and first.dims != other.dims:
            message = f"has the dimensions {', '.join(other.dims)}, but {first.path} has"
            message += f" {', '.join(first.dims)}; merge it into another folder"
            raise invalid(str(other.path), message)
        changed = differences(first.parameters, other.parameters)
        if listed := "; ".join(str(each) for each in changed if each.key[0] not in MAY_DIFFER):
            message = f"was computed with other settings than {first.path} ({listed}); merge it"
            message += " into another folder, or run both as one workflow with a list of values"
            mistakes.append(Mistake(str(other.path), message))
    if not any_code:
        models: dict[str, Path] = {}
        for folder in folders:
            for case_id in folder.results:
                models.setdefault(folder.model(case_id), folder.path)
        if len(models) > 1:
            listed = ", ".join(f"{name or 'unknown'} in {path}" for name, path in models.items())
            message = f"hold cases of different models ({listed}); run the older ones again,"
            mistakes.append(Mistake("folders", f"{message} or allow any model (any_code)"))
    raise_if_any(mistakes or _contradictions(folders))


def _contradictions(folders: Sequence[FolderContents]) -> list[Mistake]:
    """Designs that are another case in another folder, or the same case with other numbers."""
    mistakes: dict[str, Mistake] = {}
    owners_by_design: dict[Labels, tuple[FolderContents, str]] = {}
    owners_by_case: dict[str, FolderContents] = {}
    for folder in folders:
        for labels, design in folder.designs.items():
            owner, case_id = owners_by_design.setdefault(labels, (folder, design.case_id))
            if case_id != design.case_id:
                label = results_folder.label_text(folder.dims, labels)
                message = (
                    f"has {label} as {design.case_id}, and {owner.path} as {case_id}, with other"
                )
                message += " settings; merge it into another folder"
                mistakes[design.case_id] = Mistake(str(folder.path), message)
        for case_id in folder.results:
            owner = owners_by_case.setdefault(case_id, folder)
            if owner is folder or case_id in mistakes:
                continue
            if case_id in owner.undamaged & folder.undamaged:
                one, other = (case_file.case_path(each.path, case_id) for each in (owner, folder))
                if filecmp.cmp(one, other, shallow=False):
                    continue
            agree, line = comparison(folder.numbers(case_id), owner.numbers(case_id))
            if not agree:
                message = f"has other numbers in {folder.path} than in {owner.path}"
                message += f" ({line.partition(':')[0]}); compute it alone with knitlab"
                message += " reproduce, and remove the wrong one"
                mistakes[case_id] = Mistake(f"case {case_id}", message)
    named = list(mistakes.values())[:MAX_CASES_NAMED]
    if len(mistakes) > MAX_CASES_NAMED:
        named.append(Mistake("folders", f"contradict each other in {len(mistakes)} cases in all"))
    return named
