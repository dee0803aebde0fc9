"""Sources: simulations and experiments side by side on one grid of designs."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import is_measured
from knitlab.cube.schema import DESIGN_DIMS, Status


def lines_of(cube: xr.Dataset) -> str:
    """Line style of a cube: dashed if it is measured, as in the paper."""
    return "--" if is_measured(cube) else "-"


def on_one_grid(cubes: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Cubes of checkerboards, each extended to the designs of all of them."""
    labels = {
        dim: np.unique(np.concatenate([cube[dim].values for cube in cubes])) for dim in DESIGN_DIMS
    }
    return [cube.reindex(labels, fill_value=missing_values(cube)) for cube in cubes]


def missing_values(cube: xr.Dataset) -> dict[str, object]:
    """What stands for every variable of a cube where a design does not exist."""
    fill = {"status": Status.excluded, "case_id": "", "code": ""}
    rest = {str(name): np.nan for name in cube.data_vars if name not in fill}
    return rest | {name: value for name, value in fill.items() if name in cube}
