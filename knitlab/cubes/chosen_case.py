"""From a cube and selections to case files: one design, or every design. Needs no JAX."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool

from knitlab.cubes.case_file import case_path, in_cloth, read_case
from knitlab.cubes.cube_file import design_dims, is_case, is_measured, source_of
from knitlab.cubes.normalised import require
from knitlab.cubes.query import query_cubes
from knitlab.cubes.selection import (
    chosen_indices,
    only_design,
    refuse_others,
    select,
    selections_along,
)
from knitlab.io.errors import ErrorCollector, invalid, raise_if_any
from knitlab.io.progress import each
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import Status


def selected_case(cube: xr.Dataset, selections: Mapping[str, Any]) -> xr.Dataset:
    """The case file of the one design of a cube that selections leave, or the test itself."""
    if is_case(cube):
        if "position" not in cube:
            raise invalid("cube", "has no node positions; give a dataset of knitlab.simulate")
        refuse_others(selections, [STRAIN], f"is not a coordinate of a test; select {STRAIN}")
        return in_cloth(cube, cube)
    dims, folder = _dims_of_shapes(cube, selections), shapes_folder(cube)
    design = only_design(cube, selections_along(selections, dims))
    name = ", ".join(f"{dim} = {design[dim].item()}" for dim in dims)
    case_id = str(design["case_id"].item())
    if not case_path(folder, case_id).exists():
        status = Status(design["status"].item())
        if status is Status.failed:
            raise invalid(name, "failed and has no shape; knitlab status says why")
        if status is Status.pending:
            raise invalid(name, "is planned but has not run; run it first")
        raise invalid(name, f"has no case file in {folder}/cases; run the design into this folder")
    return in_cloth(read_case(folder, case_id), design)


def shapes_folder(cube: xr.Dataset) -> Path:
    """The results folder with the shapes of a cube; InputError if it is not known."""
    require(cube, ["case_id"], "shapes")
    if "source" not in cube.encoding:
        raise invalid("cube", "was not opened from a file, so it has no shapes; give its path")
    return Path(cube.encoding["source"]).parent


def _dims_of_shapes(cube: xr.Dataset, selections: Mapping[str, Any]) -> tuple[str, ...]:
    """The dimensions of the designs of a cube; InputError if selections can have no shapes."""
    if is_measured(cube):
        raise invalid(source_of(cube), "was measured and has no shapes; give a simulated cube")
    known = (*design_dims(cube), STRAIN)
    hint = f"select along {', '.join(known)}"
    refuse_others(selections, known, f"is not a coordinate of a shape; {hint}")
    return known[:-1]


def for_each_design(
    compute: Callable[[xr.Dataset, Mapping[str, Any]], xr.Dataset],
    cube: xr.Dataset,
    selections: Mapping[str, Any] = {},
    where: str | None = None,
) -> xr.Dataset:
    """What ``compute`` finds in the case file of each selected design, along the cube's dimensions.

    It is given the case file and the selected strains. Designs without a case file are missing.
    """
    strains = selections_along(selections, [STRAIN])
    if is_case(cube):
        if where is not None:
            raise invalid("where", "chooses designs, but a test is a single one; leave it out")
        return compute(selected_case(cube, selections), strains)
    dims, folder = _dims_of_shapes(cube, selections), shapes_folder(cube)
    chosen_indices({STRAIN: cube[STRAIN].values}, strains)
    left = select(cube, selections_along(selections, dims))
    rows = query_cubes([left], where=where)[list(dims)].drop_duplicates()
    if rows.empty:
        raise invalid("where" if where else "selections", "leaves no design; choose others")
    mistakes, parts = ErrorCollector(), list[xr.Dataset]()
    case_files = list[tuple[xr.Dataset, dict[str, Any]]]()
    for labels in rows.itertuples(index=False, name=None):
        design = dict(zip(dims, labels, strict=True))
        with mistakes:
            case_files.append((selected_case(cube, design), design))
    if len(rows) == 1:
        raise_if_any(mistakes.all)
    if not case_files:
        message = f"none of these {len(rows)} designs has a shape; run one into this folder"
        raise invalid(str(folder / "cases"), message)
    for case_file, design in each(case_files, "design"):
        part = compute(case_file, strains)
        parts.append(part.expand_dims({dim: [label] for dim, label in design.items()}))
    found = xr.merge(parts, join="outer", compat="no_conflicts", combine_attrs="override")
    # Designs are in the order of the cube, before what else there is.
    known = {dim: cube[dim][cube[dim].isin(found[dim])] for dim in dims}
    found = xr.merge([xr.Dataset(coords=known), found.reindex(known)], combine_attrs="no_conflicts")
    units = sorted({part.attrs["length_unit"] for part in parts})
    return found.transpose(*dims, ...).assign_attrs(length_unit=" and ".join(units))


def has_shape(case_file: xr.Dataset) -> Bool[np.ndarray, " strain"]:
    """Whether a case has its shape at every applied strain."""
    if "position" not in case_file:
        return np.zeros(case_file.sizes[STRAIN], bool)
    # Nodes outside a shaped piece have none.
    positions = case_file["position"].transpose(STRAIN, ...).values
    return np.isfinite(positions).any(axis=(1, 2, 3))


def reached_strains(
    case_file: xr.Dataset, selections: Mapping[str, Any], several: bool = False
) -> list[int]:
    """Indices of the selected strains of a case; by default the first, or if ``several`` all."""
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
        message = f"leave the strains {listed}; select one, or write a .pvd or .fold file"
        raise invalid("selections", message)
    return chosen
