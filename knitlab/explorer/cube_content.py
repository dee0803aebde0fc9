"""A cube for the page, as JSON can hold it: its dimensions, designs, variables, shapes and run."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.case_file import StoredCase, check_case_file, in_cloth, read_case
from knitlab.cube.cube_file import cube_name, design_dims, is_measured, source_of
from knitlab.cube.schema import FLAGS, INTEGERS, STRAIN, Status
from knitlab.explorer.run_report import figures_of, run_of
from knitlab.explorer.shapes import shape_of
from knitlab.sweep.results_folder import earlier_failures

EXPANDED = ("stripe_parameter",)  # dimensions along which a variable becomes one for each label
DIGITS = 6  # significant digits of the numbers on the page
NEGLIGIBLE = 1e-7  # fraction of the largest value, below which one is zero but for round-off
BAND = ("low", "high", "error")  # endings of the variables that give the band of another
WHY_NOT = {
    StoredCase.nothing: "Its case file is not beside the cube, so that there is no shape.",
    StoredCase.damaged: "Its case file is damaged, so that there is no shape.",
}


def cube_content(cube: xr.Dataset) -> dict[str, Any]:
    """What the page holds of a cube, with what is in the results folder that it was opened from."""
    folder = Path(source).parent if (source := cube.encoding.get("source")) else None
    indices = list(map(tuple, np.argwhere(cube["status"].values != Status.excluded).tolist()))
    failures = earlier_failures(folder) if folder else {}
    designs = []
    for index in indices:
        case_id = str(cube["case_id"].values[index])
        case = _case(cube, case_id, folder)
        if not isinstance(case, str):
            case = in_cloth(case, cube[dict(zip(design_dims(cube), index, strict=True))])
        shape = case if isinstance(case, str) else shape_of(case, cube[STRAIN].values)
        noted = {} if isinstance(case, str) else case.attrs
        seconds = noted.get("batch_wall_seconds")
        designs.append(
            {
                "at": index,
                "status": int(cube["status"].values[index]),
                "case_id": case_id,
                "reason": failures.get(case_id, noted).get("reason", ""),
                "seconds": None if seconds is None else float(seconds),
                "shape": None if isinstance(shape, str) else shape,
                "why_no_shape": shape if isinstance(shape, str) else "",
            }
        )
    return {
        "name": cube_name(cube),
        "title": str(cube.attrs.get("title", "")),
        "source": source_of(cube),
        "dims": [
            {
                "name": dim,
                "long_name": cube[dim].attrs.get("long_name", dim),
                "units": cube[dim].attrs.get("units", "1"),
                "values": cube[dim].values.tolist(),
            }
            for dim in design_dims(cube)
        ],
        "strains": cube[STRAIN].values.tolist(),
        "designs": designs,
        "variables": variables_of(cube, indices),
        "run": run_of(cube, designs, folder),
        "figures": figures_of(folder) if folder else {"shown": [], "left_out": 0},
    }


def _case(cube: xr.Dataset, case_id: str, folder: Path | None) -> xr.Dataset | str:
    if is_measured(cube):
        return "It was measured, so that there is no shape."
    if folder is None:
        return "The cube was not opened from a file, so that there is no shape."
    stored = check_case_file(folder, case_id) if case_id else StoredCase.nothing
    return WHY_NOT.get(stored) or read_case(folder, case_id)


def variables_of(cube: xr.Dataset, indices: Sequence[tuple[int, ...]]) -> list[dict[str, Any]]:
    """Variables of designs, of their strains or stripe parameters, with values at some designs."""
    numbers = [
        str(name)
        for name in cube.data_vars
        if name not in FLAGS and cube[name].dtype.kind in "fiub"
    ]
    contents = {one["name"]: one for name in numbers for one in _contents(cube, name, indices)}
    for name, content in contents.items():
        ends = {end: f"{name}_{end}" for end in BAND}
        content["band"] = {end: edge for end, edge in ends.items() if edge in contents}
    return list(contents.values())


def _contents(
    cube: xr.Dataset, name: str, indices: Sequence[tuple[int, ...]]
) -> Iterator[dict[str, Any]]:
    """A variable with one number for a design or for each of its states; else nothing."""
    variable, dims = cube[name], design_dims(cube)
    further = [str(dim) for dim in variable.dims if dim not in (*dims, STRAIN)]
    if not set(dims) <= set(variable.dims) or not set(further) <= set(EXPANDED):
        return
    for labels in itertools.product(*(cube[dim].values.tolist() for dim in further)):
        one = variable.sel(dict(zip(further, labels, strict=True))).transpose(*dims, ...)
        values = np.array([one.values[index] for index in indices], float)
        if not np.isfinite(values).any():
            continue
        values[np.abs(values) < NEGLIGIBLE * np.nanmax(np.abs(values))] = 0
        label = ", ".join(map(str, labels))
        yield {
            "name": f"{name}[{label}]" if label else name,
            "long_name": f"{one.attrs.get('long_name', name)}{f': {label}' if label else ''}",
            "units": one.attrs.get("units", "1"),
            "description": one.attrs.get("description", ""),
            "along_strain": STRAIN in one.dims,
            "whole": name in INTEGERS,
            "values": [
                float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
                for value in values.ravel().tolist()
            ],
        }
