"""The cube: every case of a plan on one labelled grid."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.sweep.case import Label
from knitlab.sweep.case_file import case_path, read_case
from knitlab.sweep.design_space import Design
from knitlab.sweep.files import written_whole
from knitlab.sweep.measurement import variables_of
from knitlab.sweep.plan import Plan
from knitlab.sweep.provenance import provenance
from knitlab.sweep.registry import VARIABLES, Status, described, encoding


def build_cube(plan: Plan, results: Path, failed: dict[str, str]) -> xr.Dataset:
    """Cube of a plan, from its case files.

    Combinations that the sweep does not hold are ``excluded``; cases without a file are
    ``failed`` if they are among ``failed``, else ``pending``.

    Args:
        plan: what was to be simulated.
        results: results folder of the workflow.
        failed: reasons by case identifier.
    """
    first = next(iter(plan.cases.values()))
    designs = [*(tuple(case.design.values()) for case in plan.cases.values()), *plan.excluded]
    labels = [_along(designs, place) for place in range(len(plan.dims))]
    sizes = {
        "applied_strain": len(first.applied_strain),
        "cell_y": first.unit_cells[0],
        "cell_x": first.unit_cells[1],
    }
    grid = tuple(map(len, labels))
    arrays: dict[str, np.ndarray] = {
        name: np.full((*grid, *(sizes[dim] for dim in variable.dims)), np.nan)
        for name, variable in variables_of(first).items()
        if variable.in_cube
    }
    arrays["status"] = np.full(grid, Status.excluded, np.int8)
    arrays["case_id"] = np.full(grid, "", dtype=f"U{max(map(len, plan.cases))}")

    for case_id, case in plan.cases.items():
        place = tuple(
            along.index(label) for along, label in zip(labels, case.design.values(), strict=True)
        )
        if case_path(results, case_id).is_file():
            dataset = read_case(results, case_id)
            for name, array in arrays.items():
                array[place] = dataset[name].values[()]
        else:
            arrays["periods"][place] = case.periods
            arrays["case_id"][place] = case_id
            arrays["status"][place] = Status.failed if case_id in failed else Status.pending

    variables: dict[str, Any] = {
        name: ((*plan.dims, *VARIABLES[name].dims), array) for name, array in arrays.items()
    }
    coordinates = {
        **dict(zip(plan.dims, labels, strict=True)),
        "applied_strain": list(first.applied_strain),
        "cell_y": np.arange(sizes["cell_y"]),
        "cell_x": np.arange(sizes["cell_x"]),
    }
    cube = described(xr.Dataset(variables, coordinates))
    reading = {
        f"reading_{key}": value
        for key, value in vars(first.reading).items()
        if key not in plan.dims
    }
    cube.attrs |= (
        provenance()
        | reading
        | {
            "title": plan.title,
            "workflow": plan.workflow,
            "method": first.method,
            "parameters": json.dumps(plan.record()),
        }
    )
    return cube


def _along(designs: Sequence[Design], place: int) -> list[Label]:
    """Labels along one dimension: numbers ascending, words as they come."""
    labels = list(dict.fromkeys(design[place] for design in designs))
    return labels if any(isinstance(label, str) for label in labels) else sorted(labels)


def write_cube(cube: xr.Dataset, path: Path) -> None:
    """Replace a cube's file whole, or leave the old one."""
    with written_whole(path) as temporary:
        cube.to_netcdf(temporary, encoding=encoding(cube))
