"""Merging: results folders of one workflow become one, unless they contradict each other."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cube.case_file import (
    StoredCase,
    case_path,
    check_case_file,
    checksum_path,
    read_case,
    read_code,
)
from knitlab.cube.common_settings import differences, parameters_of
from knitlab.cube.cube_file import (
    CUBE,
    design_dims,
    is_measured,
    joined_cubes,
    open_cube,
    write_cube,
)
from knitlab.cube.schema import Status
from knitlab.io.atomic_write import atomic_write, clear_unfinished
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.lock import held
from knitlab.sweep.cube import GAUGE_ATTRIBUTES, MAY_DIFFER, build_cube
from knitlab.sweep.plan import joined_plan
from knitlab.sweep.reproduce import comparison
from knitlab.sweep.results_folder import (
    PLAN,
    CaseState,
    Cell,
    Design,
    Failure,
    cells,
    earlier_failures,
    read_plan,
    survey,
    write_failures,
)

CASES = "cases"
COMPARED = ("poisson_ratio", "reaction_force")
MOST_NAMED = 5
"""Largest number of cases that a message names."""


@dataclass(frozen=True)
class Merge:
    """The result of a merge: the folder that was merged into, and its cube as written.

    Case files that it did not have were ``copied``, named by their identifiers; those that are
    damaged in the sources are left out.
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


@dataclass(frozen=True)
class FolderContents:
    """What a results folder of one workflow holds: plan, cube, and case files by their state."""

    path: Path
    record: Mapping[str, Any] | None
    cube: xr.Dataset | None
    sound: frozenset[str]
    damaged: tuple[Path, ...]

    @classmethod
    def of(cls, path: Path) -> "FolderContents":
        """Read a results folder; BadInput if it cannot be read, or holds an experiment."""
        cube = open_cube(path) if (path / CUBE).exists() else None
        if cube is not None and is_measured(cube):
            raise fault(str(path), "holds an experiment; only simulations are merged")
        record = read_plan(path) if (path / PLAN).exists() else None
        names = [file.stem for file in (path / CASES).glob("*.nc")]
        sound = {name for name in names if check_case_file(path, name) is StoredCase.sound}
        damaged = tuple(case_path(path, name) for name in names if name not in sound)
        return cls(path, record, cube, frozenset(sound), damaged)

    @property
    def workflow(self) -> str:
        """Name of the workflow."""
        if self.record is not None:
            return str(self.record["workflow"])
        return self.path.name if self.cube is None else str(self.cube.attrs["workflow"])

    @cached_property
    def cells(self) -> dict[Design, Cell]:
        """The designs of its cube."""
        return cells(self.cube)

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of its designs; empty if it does not state any."""
        if self.cube is not None:
            return design_dims(self.cube)
        return () if self.record is None else tuple(self.record["dims"])

    @property
    def parameters(self) -> dict[str, Any]:
        """The settings that its designs share, and its gauge."""
        if self.cube is None:
            return {} if self.record is None else dict(self.record["parameters"])
        gauge = {name: self.cube.attrs.get(name) for name in GAUGE_ATTRIBUTES.values()}
        return parameters_of(self.cube) | gauge

    @property
    def codes(self) -> set[str]:
        """Fingerprints of the codes that computed its cases."""
        known = {cell.case_id: cell.code for cell in self.cells.values() if cell.has_results}
        read = (read_code(self.path, case_id) or "" for case_id in self.sound - known.keys())
        return {*known.values(), *read}

    def numbers(self, cell: Cell) -> xr.Dataset:
        """What is compared of a design of its cube."""
        assert self.cube is not None
        values = {name: ("applied_strain", self.cube[name].values[cell.place]) for name in COMPARED}
        return xr.Dataset(values, {"applied_strain": self.cube["applied_strain"].values})


def merge_folders(folders: Sequence[Path], results: Path, *, any_code: bool = False) -> Merge:
    """Join the case files, cubes, plans and failures of several results folders.

    Everything is compared before anything is written; then case files are copied and the cube is
    replaced, each atomically. The sources are not changed, and merging again changes nothing. See
    :func:`knitlab.merge` for the arguments.

    Raises:
        BadInput: if the folders contradict each other or hold several workflows; the message names
            what differs.
        CannotWrite: if the merged folder cannot be written.
    """
    paths = dict.fromkeys(path.resolve() for each in folders for path in _results_folders(each))
    sources = [FolderContents.of(path) for path in paths]
    names = {source.workflow: source.path for source in sources}
    if len(names) > 1:
        listed = ", ".join(f"{name} in {path}" for name, path in names.items())
        raise fault("folders", f"hold results of several workflows ({listed}); merge one at a time")
    target = (results / next(iter(names))).resolve()
    with held(target):
        clear_unfinished(target)
        merged = [source for source in sources if source.path != target]
        if _holds_results(target):
            merged = [FolderContents.of(target), *merged]
        _check_agreement(merged, any_code)
        copied = tuple(_copied(merged, target))
        cube = _joined(merged, target)
        write_cube(cube, target / CUBE)
        failures: dict[str, Failure] = {}
        for source in reversed(merged):
            failures |= earlier_failures(source.path)
        bad = cube["status"].isin([Status.not_converged, Status.failed]).values
        not_ok = cube["case_id"].values[bad].tolist()
        write_failures(target, [failures[name] for name in not_ok if name in failures])
    sound = {case_id for source in merged for case_id in source.sound}
    damaged = {path for source in sources for path in source.damaged if path.stem not in sound}
    sources_paths = tuple(source.path for source in sources)
    return Merge(results / target.name, cube, sources_paths, copied, tuple(sorted(damaged)))


def _results_folders(path: Path) -> list[Path]:
    """A results folder of a workflow, or those in a folder of such folders."""
    if _holds_results(path):
        return [path]
    found = sorted(each for each in path.glob("*") if each.is_dir() and _holds_results(each))
    if not found:
        raise fault(str(path), f"holds no results: neither {PLAN} nor {CUBE}; check the path")
    return found


def _holds_results(path: Path) -> bool:
    return any((path / name).exists() for name in (PLAN, CUBE, CASES))


def _copied(merged: Sequence[FolderContents], target: Path) -> Iterator[str]:
    """Copy the case files that the target lacks; yields their identifiers."""
    owners = {case_id: source.path for source in reversed(merged) for case_id in source.sound}
    for case_id, owner in sorted(owners.items()):
        if owner == target:
            continue
        # The checksum first, as where a case is simulated.
        for path in (checksum_path, case_path):
            with atomic_write(path(target, case_id)) as temporary:
                shutil.copyfile(path(owner, case_id), temporary)
        yield case_id


def _joined(merged: Sequence[FolderContents], target: Path) -> xr.Dataset:
    """The cube of all folders and of the case files in the target, which gets their joint plan."""
    cubes = [source.cube for source in merged if source.cube is not None]
    old = joined_cubes(cubes) if cubes else None
    records = [source.record for source in merged if source.record]
    if not records:
        if old is None:
            path = merged[0].path
            raise fault(str(path), f"has neither {PLAN} nor {CUBE}; run its workflow there first")
        return old
    plan = joined_plan(records, str(target))
    plan.write(target / PLAN)
    states = survey(plan.designs, target, cells(old), check=False)
    failed = {
        case_id
        for source in merged
        for case_id, entry in earlier_failures(source.path).items()
        if entry["status"] == Status.failed.name
    }
    return build_cube(
        plan,
        target,
        old,
        kept=[name for name, state in states.items() if state is CaseState.done],
        damaged=[name for name, state in states.items() if state is CaseState.damaged],
        failed=failed,
    )


def _check_agreement(folders: Sequence[FolderContents], any_code: bool) -> None:
    """Refuse folders that differ in dimensions, settings, gauges, codes or numbers of cases."""
    first, *others = folders
    faults: list[Fault] = []
    for other in others:
        if first.dims and other.dims and first.dims != other.dims:
            along, own = ", ".join(other.dims), ", ".join(first.dims)
            raise fault(
                str(other.path),
                f"has the dimensions {along}, but {first.path} has {own}; merge it into another"
                " folder",
            )
        changed = [
            str(change)
            for change in differences(first.parameters, other.parameters)
            if change.key[0] not in MAY_DIFFER
        ]
        if changed:
            problem = (
                f"was computed otherwise than {first.path} ({'; '.join(changed)}); merge it into"
                " another folder, or run both as one workflow with a list of values"
            )
            faults.append(Fault(str(other.path), problem))
    codes: dict[str, Path] = {}
    for folder in folders if not any_code else ():
        for code in folder.codes:
            codes.setdefault(code, folder.path)
    if len(codes) > 1:
        listed = ", ".join(f"{code or 'unknown'} in {path}" for code, path in codes.items())
        problem = f"of different code ({listed}); run the older ones again, or allow any code"
        faults.append(Fault("folders", f"hold cases {problem}"))
    if not faults:
        faults = _contradictions(folders)
    if faults:
        raise BadInput(faults)


def _contradictions(folders: Sequence[FolderContents]) -> list[Fault]:
    """Faults of designs that are another case, or the same case with other numbers."""
    found: dict[str, Fault] = {}
    in_cube: dict[Design, tuple[FolderContents, Cell]] = {}
    in_file: dict[str, FolderContents] = {}

    def compare(
        case_id: str,
        owner: FolderContents,
        one: xr.Dataset,
        folder: FolderContents,
        two: xr.Dataset,
    ) -> None:
        # The strains of a cube are those of all its designs.
        agree, sentence = comparison(*xr.align(two, one, join="outer"))
        if not agree:
            problem = (
                f"has other numbers in {folder.path} than in {owner.path}"
                f" ({sentence.partition(':')[0]}); compute it alone with knitlab reproduce, and"
                " remove the wrong one"
            )
            found[case_id] = Fault(f"case {case_id}", problem)

    for folder in folders:
        for design, cell in folder.cells.items():
            if not cell.has_results:
                continue
            owner, its = in_cube.setdefault(design, (folder, cell))
            if its.case_id != cell.case_id:
                labels = zip(folder.dims, design, strict=True)
                found[cell.case_id] = Fault(
                    str(folder.path),
                    f"has the design {'  '.join(f'{name} {label}' for name, label in labels)} as"
                    f" {cell.case_id}, but {owner.path} has it as {its.case_id}, computed with"
                    " other settings; merge it into another folder",
                )
            elif owner is not folder:
                compare(cell.case_id, owner, owner.numbers(its), folder, folder.numbers(cell))
        for case_id in folder.sound - found.keys():
            owner = in_file.setdefault(case_id, folder)
            sums = {checksum_path(each.path, case_id).read_text() for each in (owner, folder)}
            if len(sums) > 1:
                one, two = (read_case(each.path, case_id) for each in (owner, folder))
                compare(case_id, owner, one, folder, two)
    named = list(found.values())[:MOST_NAMED]
    if len(found) > MOST_NAMED:
        named.append(Fault("folders", f"contradict each other in {len(found)} cases in all"))
    return named
