"""The cube: every case of a plan on one labelled grid."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.sweep.case_file import case_path, read_case
from knitlab.sweep.files import written_whole
from knitlab.sweep.plan import Plan
from knitlab.sweep.provenance import provenance
from knitlab.sweep.registry import DESIGN_DIMS, VARIABLES, Status, described, encoding


def build_cube(plan: Plan, results: Path, failed: dict[str, str]) -> xr.Dataset:
    """Cube of a plan, from its case files.

    Combinations that the sweep does not hold are ``excluded``; cases without a file are
    ``failed`` if they are among ``failed``, else ``pending``.

    Args:
        plan: what was to be simulated.
        results: results folder of the workflow.
        failed: reasons by case identifier.
    """
    designs = {(case.n_stripe, case.n_subunit): case for case in plan.cases.values()}
    asked = [*designs, *plan.excluded]
    n_stripe = sorted({design[0] for design in asked})
    n_subunit = sorted({design[1] for design in asked})
    first = next(iter(plan.cases.values()))
    sizes = {
        "applied_strain": len(first.applied_strain),
        "cell_y": first.unit_cells[0],
        "cell_x": first.unit_cells[1],
    }
    arrays: dict[str, np.ndarray] = {}
    for name, variable in VARIABLES.items():
        if variable.in_cube:
            extent = (len(n_stripe), len(n_subunit), *(sizes[dim] for dim in variable.dims))
            arrays[name] = np.full(extent, np.nan)
    arrays["status"] = np.full(arrays["status"].shape, Status.excluded, np.int8)
    longest = max(map(len, plan.cases))
    arrays["case_id"] = np.full(arrays["case_id"].shape, "", dtype=f"U{longest}")

    for design, case in designs.items():
        place = n_stripe.index(design[0]), n_subunit.index(design[1])
        if case_path(results, case.case_id).is_file():
            dataset = read_case(results, case.case_id)
            for name, array in arrays.items():
                array[place] = dataset[name].values[()]
        else:
            arrays["periods"][place] = case.periods
            arrays["case_id"][place] = case.case_id
            known = Status.failed if case.case_id in failed else Status.pending
            arrays["status"][place] = known

    variables: dict[str, Any] = {
        name: ((*DESIGN_DIMS, *VARIABLES[name].dims), array) for name, array in arrays.items()
    }
    coordinates = {
        "n_stripe": n_stripe,
        "n_subunit": n_subunit,
        "applied_strain": list(first.applied_strain),
        "cell_y": np.arange(sizes["cell_y"]),
        "cell_x": np.arange(sizes["cell_x"]),
    }
    cube = described(xr.Dataset(variables, coordinates))
    reading = {f"reading_{key}": value for key, value in vars(first.reading).items()}
    cube.attrs |= (
        provenance()
        | reading
        | {
            "title": plan.title,
            "workflow": plan.workflow,
            "parameters": json.dumps(plan.record()),
        }
    )
    return cube


def write_cube(cube: xr.Dataset, path: Path) -> None:
    """Replace a cube's file whole, or leave the old one."""
    with written_whole(path) as temporary:
        cube.to_netcdf(temporary, encoding=encoding(cube))
