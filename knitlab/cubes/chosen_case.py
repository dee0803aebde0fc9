"""The one case, and the strains of it, that selections choose."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool

from knitlab.cubes.case_file import StoredCase, check_case_file, in_cloth, read_case
from knitlab.cubes.cube_file import design_dims, is_case, is_measured, source_of
from knitlab.cubes.query import query_cubes
from knitlab.cubes.selection import (
    choices,
    chosen_indices,
    refuse_others,
    selected,
    selections_along,
)
from knitlab.io.errors import ErrorCollector, InputError, invalid
from knitlab.observables.schema import STRAIN, Status


def chosen_case(cube: xr.Dataset, selections: Mapping[str, Any]) -> xr.Dataset:
    """Contents of the case file of the one design of a cube that selections leave, or of a test.

    InputError if they leave no design or several, or beside the cube is no sound case file of it.
    """
    if is_case(cube):
        refuse_others(selections, [STRAIN], f"is of a cube; of a test, select {STRAIN} alone")
        return in_cloth(cube, cube)
    dims = _dims_of_shapes(cube, selections)
    left = selected(cube, {dim: selections[dim] for dim in dims if dim in selections})
    designs = left[["status", "case_id"]].stack(design=dims)
    designs = designs.isel(design=np.flatnonzero(designs["status"] != Status.excluded))
    if not (count := designs.sizes["design"]):
        raise invalid("selections", "leave no design of this cube; choose others")
    if count > 1:
        labels = {str(dim): np.unique(designs[dim]) for dim in dims}
        several = {dim: values for dim, values in labels.items() if len(values) > 1}
        listed = choices(xr.Dataset(coords=several), several)
        raise invalid("selections", f"leave {count} designs; select {listed}")
    (only,) = designs["design"].values
    case_id = str(designs["case_id"].item())
    name = ", ".join(f"{dim} = {value}" for dim, value in zip(dims, only, strict=True))
    folder = Path(cube.encoding["source"]).parent
    stored = check_case_file(folder, case_id) if case_id else StoredCase.nothing
    if stored is StoredCase.damaged:
        raise invalid(name, f"has a damaged case file {case_id}.nc; run the design again")
    if stored is StoredCase.nothing:
        missing = f"has no case file in {folder}/cases, and shapes are not in the cube"
        reasons = {
            Status.failed: "failed and has no shape; knitlab status says why",
            Status.pending: "is planned but has not run; run it first",
        }
        hint = f"{missing}; run the design into this folder"
        raise invalid(name, reasons.get(Status(designs["status"].item()), hint))
    index = {dim: [value] for dim, value in zip(dims, only, strict=True)}
    return in_cloth(read_case(folder, case_id), left.sel(index).squeeze(drop=True))


def _dims_of_shapes(cube: xr.Dataset, selections: Mapping[str, Any]) -> tuple[str, ...]:
    """The dimensions of the designs of a cube; InputError if selections can have no shapes."""
    if is_measured(cube):
        raise invalid(source_of(cube), "was measured and has no shapes; give a simulated cube")
    known = (*design_dims(cube), STRAIN)
    hint = f"select along {', '.join(known)}"
    refuse_others(selections, known, f"is not a coordinate of a shape; {hint}")
    return known[:-1]


def of_chosen_cases(
    compute: Callable[[xr.Dataset, Mapping[str, Any]], xr.Dataset],
    cube: xr.Dataset,
    selections: Mapping[str, Any] = {},
    where: str | None = None,
) -> xr.Dataset:
    """What is computed of a test, or the case file of each design that selections leave of a cube.

    It is computed with the selections of strains. Designs without a file are left out, and missing
    if others have their labels; ``length_unit`` names those of all. InputError if none has a file,
    or the one that is left has not.
    """
    along = selections_along(selections, [STRAIN])
    if is_case(cube):
        if where is not None:
            raise invalid("where", "is a condition on designs, and a test is one; leave it out")
        return compute(chosen_case(cube, selections), along)
    dims = _dims_of_shapes(cube, selections)
    chosen_indices({STRAIN: cube[STRAIN].values}, along)
    left = selected(cube, selections_along(selections, dims))
    rows = query_cubes([left], where=where)[list(dims)].drop_duplicates()
    if rows.empty:
        raise invalid("where" if where else "selections", "leaves no design; choose others")
    mistakes, case_files = ErrorCollector(), list[tuple[xr.Dataset, dict[str, Any]]]()
    for labels in rows.itertuples(index=False, name=None):
        design = dict(zip(dims, labels, strict=True))
        with mistakes:
            # Of a cube few designs may have their shapes beside it.
            case_files.append((chosen_case(cube, design), design))
    if len(rows) == 1 and mistakes.all:
        raise InputError(mistakes.all)
    if not case_files:
        message = f"none of these {len(rows)} designs has a shape; run one into this folder"
        raise invalid(str(Path(cube.encoding["source"]).parent / "cases"), message)
    parts = [
        compute(case_file, along).expand_dims({dim: [label] for dim, label in design.items()})
        for case_file, design in case_files
    ]
    found = xr.merge(parts, join="outer", compat="no_conflicts", combine_attrs="override")
    # Designs are in the order of the cube, before what else there is.
    known = {dim: cube[dim][cube[dim].isin(found[dim])] for dim in dims}
    found = xr.merge([xr.Dataset(coords=known), found.reindex(known)], combine_attrs="no_conflicts")
    found = found.transpose(*dims, ...)
    units = sorted({each.attrs["length_unit"] for each in parts})
    return found.assign_attrs(length_unit=" and ".join(units))


def has_shape(case_file: xr.Dataset) -> Bool[np.ndarray, " strain"]:
    """Whether a case has its shape at every applied strain."""
    if "position" not in case_file:
        return np.zeros(case_file.sizes[STRAIN], bool)
    positions = case_file["position"].transpose(STRAIN, ...).values
    return np.isfinite(positions).all(axis=(1, 2, 3))


def plies_touch(case_file: xr.Dataset) -> Bool[np.ndarray, " strain"]:
    """Whether contact pushes plies apart at every applied strain of a case."""
    if "energy_contact" not in case_file:
        return np.zeros(case_file.sizes[STRAIN], bool)
    return case_file["energy_contact"].values > 0


def chosen_strains(
    case_file: xr.Dataset, selections: Mapping[str, Any], several: bool = False
) -> list[int]:
    """Indices of the strains of a case that selections choose, one or several; all reached.

    By default the relaxed state is chosen, or every strain that was reached if several may be.
    """
    strains, reached = case_file[STRAIN].values, has_shape(case_file)
    reason = case_file.attrs.get("reason", "")
    if not reached.any():
        title = str(case_file.attrs.get("title", "test"))
        raise invalid(title, f"has no shape: {reason or 'it did not relax'}; choose another design")
    chosen = np.flatnonzero(reached).tolist() if several else [0]
    if STRAIN in selections:
        chosen = chosen_indices({STRAIN: strains}, {STRAIN: selections[STRAIN]})[STRAIN]
    if missing := [index for index in chosen if not reached[index]]:
        message = f"has no shape: {reason}; select up to {strains[reached].max():g}"
        raise invalid(f"{STRAIN} {strains[missing[0]]:g}", message)
    if len(chosen) > 1 and not several:
        listed = ", ".join(f"{strain:g}" for strain in strains[chosen])
        message = f"choose the strains {listed} for one mesh; select one, or write a .pvd or .fold"
        raise invalid("selections", message)
    return chosen
