"""A cube for the page: its dimensions, designs, variables, shapes and run."""

from pathlib import Path

import numpy as np
import xarray as xr

from knitlab.cube.case_file import StoredCase, check_case_file, read_case
from knitlab.cube.cube_file import cube_name, design_dims, is_measured, source_of
from knitlab.cube.schema import Status
from knitlab.explorer.page import Content
from knitlab.explorer.run_report import figures_of, run_of
from knitlab.explorer.shapes import shape_of
from knitlab.explorer.variables import STRAIN, variables_of
from knitlab.sweep.results_folder import earlier_failures

MEASURED = "It was measured, so that there is no shape."
NOT_FROM_FILE = "The cube was not opened from a file, so that there is no shape."
NO_FIGURES: Content = {"shown": [], "left_out": 0}
WHY_NOT = {
    StoredCase.nothing: "Its case file is not beside the cube, so that there is no shape.",
    StoredCase.damaged: "Its case file is damaged, so that there is no shape.",
}


def cube_content(cube: xr.Dataset) -> Content:
    """What the page holds of a cube.

    Shapes, reasons of failures, and figures come from the results folder that the cube was opened
    from, as far as they are there.

    Args:
        cube: the cube.
    """
    source = cube.encoding.get("source")
    folder = Path(source).parent if source else None
    dims = design_dims(cube)
    places = [
        tuple(map(int, place)) for place in np.argwhere(cube["status"].values != Status.excluded)
    ]
    strains = cube[STRAIN].values
    failures = earlier_failures(folder) if folder else {}
    designs = []
    for place in places:
        case_id = str(cube["case_id"].values[place])
        case = _case(cube, case_id, folder)
        shape = case if isinstance(case, str) else shape_of(case, strains)
        noted = {} if isinstance(case, str) else case.attrs
        seconds = noted.get("batch_wall_seconds")
        designs.append(
            {
                "at": place,
                "status": int(cube["status"].values[place]),
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
        "dims": [_dimension(cube, dim) for dim in dims],
        "strains": strains.tolist(),
        "designs": designs,
        "variables": variables_of(cube, places),
        "run": run_of(cube, designs, folder),
        "figures": figures_of(folder) if folder else NO_FIGURES,
    }


def _dimension(cube: xr.Dataset, dim: str) -> Content:
    attributes = cube[dim].attrs
    return {
        "name": dim,
        "long_name": attributes.get("long_name", dim),
        "units": attributes.get("units", "1"),
        "values": cube[dim].values.tolist(),
    }


def _case(cube: xr.Dataset, case_id: str, folder: Path | None) -> xr.Dataset | str:
    """Contents of the file of a case, or a sentence that says why there is no shape."""
    if is_measured(cube):
        return MEASURED
    if folder is None:
        return NOT_FROM_FILE
    stored = check_case_file(folder, case_id) if case_id else StoredCase.nothing
    return WHY_NOT[stored] if stored in WHY_NOT else read_case(folder, case_id)
