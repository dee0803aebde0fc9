"""What a sensor of the same fabric reads on a limb: its capacitance at the worn stretch."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cubes.cube_file import cube_name, design_dims, is_case
from knitlab.cubes.normalised import require
from knitlab.cubes.selection import select
from knitlab.export.laws.strain_tests import is_strained_across
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

NEEDED = ("capacitance", "relaxed_cell_x", "relaxed_cell_y")
SAME_DESIGN = (
    *("n_stripe", "n_subunit", "relaxed_cell_x", "relaxed_cell_y", "knit_cell_x", "knit_cell_y"),
    *("rib_period", "rib_k_s", "rib_k_t", "rib_theta_0"),
    *("garter_period", "garter_k_s", "garter_k_t", "garter_theta_0"),
)
"""Labels, sizes and stripes by which two cubes have the same design."""
ALONG_WALES = 90.0  # direction of a pull from the courses, if a cube has no other [degree]
FEWEST = 2  # strains
TOLERANCE = 1e-3  # of sizes that were simulated twice, relative


def sensor_of(
    cube: xr.Dataset,
    design: xr.Dataset,
    selections: Mapping[str, Any],
    length_ratio: float | None = None,
) -> xr.Dataset:
    """The pull along the courses of a cube with electrodes, of a design; InputError if none is.

    The wales are free, or held at ``length_ratio`` times their relaxed length.
    """
    name = cube_name(cube) or "sensor"
    load, wales = "load = weft", "with free wales"
    if length_ratio is not None:
        load = "load = biaxial_weft and load_ratio = 0, for length_ratio = 1"
        wales = f"with wales held at {length_ratio:g} times their length"
    require(cube, NEEDED, "sensors on a limb", name)
    rows = [cube]
    if not is_case(cube):
        known = {dim: value for dim, value in selections.items() if dim in cube.dims}
        stacked = select(cube, known).stack(test=design_dims(cube))
        rows = [stacked.isel(test=number) for number in range(stacked.sizes["test"])]
    alike = [row for row in rows if _is_alike(row, design)]
    if not alike:
        message = "has no test of the design of the law; simulate that with electrodes"
        raise invalid(name, f"{message} and {load}")
    pulls = [row for row in alike if _is_worn(row, length_ratio)]
    if not pulls:
        raise invalid(name, f"has no pull along the courses, {wales}; simulate it with {load}")
    if len(pulls) > 1:
        message = f"has {len(pulls)} such pulls; give a cube with one layout of electrodes"
        raise invalid(name, message)
    known = np.isfinite(pulls[0]["capacitance"].values)
    reached = len(known) if known.all() else int(known.argmin())
    if reached < FEWEST:
        message = f"has a capacitance at {reached} strains from rest on, and {FEWEST} are needed"
        raise invalid(name, f"{message}; choose another layout")
    return pulls[0].isel({STRAIN: slice(reached)})


def _is_worn(row: xr.Dataset, length_ratio: float | None) -> bool:
    if float(row.get("load_direction", ALONG_WALES)) != 0:
        return False
    if length_ratio is None:
        return not is_strained_across(row)
    lengths = 1 + row["mean_strain_yy"].values
    return np.allclose(lengths[np.isfinite(lengths)], length_ratio, rtol=0, atol=TOLERANCE)


def _is_alike(row: xr.Dataset, design: xr.Dataset) -> bool:
    names = [name for name in SAME_DESIGN if name in row and name in design]
    return all(np.isclose(row[name], design[name], rtol=TOLERANCE) for name in names)


def add_readings(table: pd.DataFrame, sensor: xr.Dataset) -> None:
    """Add the capacitance [pF], its change from the relaxed one, and its slope by the stretch."""
    strain, capacitance = sensor[STRAIN].values, sensor["capacitance"].values
    stretch = table["stretch"].clip(lower=0)
    beyond = stretch > strain[-1]
    columns = {
        "capacitance": np.interp(stretch, strain, capacitance),
        "capacitance_change": np.interp(stretch, strain, capacitance) - capacitance[0],
        "capacitance_slope": np.interp(stretch, strain, np.gradient(capacitance, strain)),
    }
    for name, values in columns.items():
        table[name] = np.where(beyond, np.nan, values)
        table.attrs["units"][name] = "pF"
