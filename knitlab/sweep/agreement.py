"""Agreement of results folders: whether they can be joined."""

from collections.abc import Sequence

import xarray as xr

from knitlab.cube.case_file import checksum_path, read_case
from knitlab.cube.common_settings import differences
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.sweep.gauge import ATTRIBUTES
from knitlab.sweep.join import MAY_DIFFER
from knitlab.sweep.reproduce import comparison
from knitlab.sweep.results_folder import ResultsFolder
from knitlab.sweep.survey import Cell

COMPARED = ("poisson_ratio", "reaction_force")
MOST_NAMED = 5
"""Largest number of cases that a message names."""


def check_agreement(folders: Sequence[ResultsFolder], *, any_code: bool) -> None:
    """Check that results folders of one workflow can be joined.

    Args:
        folders: the folders; all are compared with the first, and their cases with each other.
        any_code: whether results may be of different code.

    Raises:
        BadInput: with everything that contradicts: dimensions, settings, gauges, codes, and cases.
    """
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
        faults += _settings(first, other)
    if not any_code:
        faults += _codes(folders)
    if not faults:
        faults += _cases(folders)
    if faults:
        raise BadInput(faults)


def _settings(first: ResultsFolder, other: ResultsFolder) -> list[Fault]:
    """Faults of the settings in which the designs of two folders differ."""
    changed = [
        str(change)
        for change in differences(first.parameters, other.parameters)
        if change.key[0] not in MAY_DIFFER
    ]
    if first.cube is not None and other.cube is not None:
        gauges = [
            {name: cube.attrs.get(name) for name in ATTRIBUTES.values()}
            for cube in (first.cube, other.cube)
        ]
        changed += map(str, differences(gauges[0], gauges[1]))
    if not changed:
        return []
    listed = "; ".join(changed)
    return [
        Fault(
            str(other.path),
            f"was computed otherwise than {first.path} ({listed}); merge it into another folder,"
            " or run both as one workflow with a list of values",
        )
    ]


def _codes(folders: Sequence[ResultsFolder]) -> list[Fault]:
    """Faults of folders whose cases are of other code than those before."""
    seen: dict[str, ResultsFolder] = {}
    for folder in folders:
        for code in folder.codes.values():
            seen.setdefault(code, folder)
    if len(seen) < 2:
        return []
    listed = ", ".join(f"{code or 'unknown'} in {folder.path}" for code, folder in seen.items())
    problem = f"of different code ({listed}); run the older ones again, or allow any code"
    return [Fault("folders", f"hold cases {problem}")]


def _cases(folders: Sequence[ResultsFolder]) -> list[Fault]:
    """Faults of designs that are another case, or the same case with other numbers."""
    found: dict[str, Fault] = {}
    owners: dict[tuple[object, ...], tuple[ResultsFolder, Cell]] = {}
    files: dict[str, ResultsFolder] = {}
    for folder in folders:
        for design, cell in folder.cells.items():
            if not cell.has_results:
                continue
            owner, its = owners.setdefault(design, (folder, cell))
            if owner is folder:
                continue
            if its.case_id != cell.case_id:
                found[cell.case_id] = Fault(
                    str(folder.path),
                    f"has the design {_label(folder, design)} as {cell.case_id}, but {owner.path}"
                    f" has it as {its.case_id}, computed with other settings; merge it into another"
                    " folder",
                )
            elif sentence := _other_numbers(owner, its, folder, cell):
                found[cell.case_id] = _contradiction(cell.case_id, owner, folder, sentence)
        for case_id in folder.case_files - found.keys():
            owner = files.setdefault(case_id, folder)
            if owner is not folder and _checksum(owner, case_id) != _checksum(folder, case_id):
                one, other = (read_case(each.path, case_id) for each in (owner, folder))
                agree, sentence = comparison(other, one)
                if not agree:
                    found[case_id] = _contradiction(case_id, owner, folder, sentence)
    named = list(found.values())[:MOST_NAMED]
    if len(found) > MOST_NAMED:
        named.append(Fault("folders", f"contradict each other in {len(found)} cases in all"))
    return named


def _other_numbers(
    owner: ResultsFolder, its: Cell, folder: ResultsFolder, cell: Cell
) -> str | None:
    """How far two cubes differ in a case, if they do not agree."""
    one, other = _compared(owner, its), _compared(folder, cell)
    if one.identical(other):
        return None
    # The strains of a cube are those of all its designs.
    agree, sentence = comparison(*xr.align(other, one, join="outer"))
    return None if agree else sentence


def _compared(folder: ResultsFolder, cell: Cell) -> xr.Dataset:
    """What is compared of a case in a cube."""
    assert folder.cube is not None
    values = {name: ("applied_strain", folder.cube[name].values[cell.place]) for name in COMPARED}
    return xr.Dataset(values, {"applied_strain": folder.cube["applied_strain"].values})


def _contradiction(
    case_id: str, owner: ResultsFolder, folder: ResultsFolder, sentence: str
) -> Fault:
    differ = sentence.partition(":")[0]
    return Fault(
        f"case {case_id}",
        f"has other numbers in {folder.path} than in {owner.path} ({differ}); compute it alone with"
        " knitlab reproduce, and remove the wrong one",
    )


def _checksum(folder: ResultsFolder, case_id: str) -> str:
    return checksum_path(folder.path, case_id).read_text()


def _label(folder: ResultsFolder, design: tuple[object, ...]) -> str:
    return "  ".join(f"{name} {its}" for name, its in zip(folder.dims or (), design, strict=True))
