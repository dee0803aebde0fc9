"""Sources: simulations and experiments side by side on one grid of designs."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from knitlab.io.cube_file import is_measured
from knitlab.io.design_status import Status
from knitlab.io.schema import DESIGN_DIMS


def lines_of(cube: xr.Dataset) -> str:
    """Line style of a cube: dashed if it is measured, as in the paper."""
    return "--" if is_measured(cube) else "-"


def on_one_grid(cubes: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Cubes of checkerboards, each extended to the designs of all of them."""
    labels = {
        dim: np.unique(np.concatenate([cube[dim].values for cube in cubes])) for dim in DESIGN_DIMS
    }
    fill = {"status": Status.excluded, "case_id": "", "code": ""}
    return [cube.reindex(labels, fill_value=_known(cube, fill)) for cube in cubes]


def _known(cube: xr.Dataset, fill: dict[str, object]) -> dict[str, object]:
    rest = {str(name): np.nan for name in cube.data_vars if name not in fill}
    return rest | {name: value for name, value in fill.items() if name in cube}
