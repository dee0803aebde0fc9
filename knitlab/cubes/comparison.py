"""Comparison: differences between a simulation and experiments, curve by curve."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cubes.cube_file import cells_across, is_measured, source_of, swept_dims
from knitlab.cubes.selection import choices
from knitlab.io.errors import invalid
from knitlab.observables.schema import CYCLE, DESIGN_DIMS, STRAIN, VARIABLES
from knitlab.observables.status import RUN, Status

COMPARED = (
    *("mean_strain_xx", "mean_strain_yy", "poisson_ratio", "reaction_force"),
    "capacitance_ratio",
)  # curves along the applied strain


class CurveDifference(NamedTuple):
    """Root mean square difference of two curves, with its standard error."""

    strains: int  # their number
    rms_difference: float
    uncertainty: float
    noise: float  # root mean square that the errors would make between equal curves


def difference(
    simulated: np.ndarray, measured: np.ndarray, errors: np.ndarray
) -> CurveDifference | None:
    """The difference of curves at the same strains, NaN where missing; None if none is common."""
    # Errors are independent between strains, and 0 where unknown, unless all are.
    both = np.isfinite(simulated) & np.isfinite(measured)
    count = int(both.sum())
    if not count:
        return None
    deviation = (simulated - measured)[both]
    error = errors[both]
    rms = float(np.sqrt((deviation**2).mean()))
    if np.isnan(error).all():
        return CurveDifference(count, rms, np.nan, np.nan)
    error = np.nan_to_num(error)
    noise = float(np.sqrt((error**2).mean()))
    # Near 0 the root is not linear in the errors, and is bounded by the errors themselves.
    by_slope = np.sqrt((deviation**2 * error**2).sum()) / (count * rms) if rms > noise else noise
    return CurveDifference(count, rms, float(by_slope), noise)


def compared(simulation: xr.Dataset, experiments: Sequence[xr.Dataset]) -> pd.DataFrame:
    """One row for each curve of a design that a simulation and an experiment both have.

    The simulation is interpolated linearly to the measured strains, its force scaled to the unit
    cells across the sample, and capacitances to the first common strain.
    """
    if is_measured(simulation):
        message = f"begins with a simulation, but {source_of(simulation)} was measured"
        raise invalid("compare", message)
    if not all(map(is_measured, experiments)):
        raise invalid("compare", "takes one simulation, and experiments after it")
    swept = swept_dims(simulation)
    if several := [dim for dim in swept if simulation.sizes[dim] > 1]:
        listed = choices(simulation, several)
        raise invalid("compare", f"takes one value of each setting; select {listed}")
    simulation = simulation.isel(dict.fromkeys(swept, 0), drop=True)
    rows = [row for experiment in experiments for row in _rows(simulation, experiment)]
    if not rows:
        message = "no curve of a design is both simulated and measured; choose other cubes"
        raise invalid("compare", message)
    return pd.DataFrame(rows)


def _rows(simulation: xr.Dataset, experiment: xr.Dataset) -> Iterator[dict[str, Any]]:
    across = cells_across(experiment)
    stacked = experiment.stack(design=experiment["status"].dims)
    for number in np.flatnonzero(stacked["status"] == Status.ok):
        measured = stacked.isel(design=number)
        labels = {dim: int(measured[dim]) for dim in DESIGN_DIMS}
        if any(label not in simulation[dim].values for dim, label in labels.items()):
            continue
        simulated = simulation.sel(labels)
        if int(simulated["status"]) not in RUN:
            continue
        if CYCLE in measured.coords:
            labels[CYCLE] = int(measured[CYCLE])
        for name in (name for name in COMPARED if name in simulated and name in measured):
            curve = simulated[name].dropna(STRAIN)
            if name == "reaction_force":
                cells = simulated["strain_yy"].notnull().any([STRAIN, "cell_y"])
                curve = curve * (across / int(cells.sum()))
            at, values, errors = _at_measured_strains(name, curve, measured)
            if (differing := difference(at, values, errors)) is not None:
                yield {
                    "source": source_of(experiment),
                    **labels,
                    "variable": name,
                    **differing._asdict(),
                    "largest_measured": float(np.nanmax(np.abs(values))),
                    "units": VARIABLES[name].units,
                }


def _at_measured_strains(
    name: str, curve: xr.DataArray, measured: xr.Dataset
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Simulated and measured values of a curve, and standard errors; NaN where unknown."""
    values = measured[name].values
    unknown = np.nan * measured[name]
    at: np.ndarray = unknown.values
    if curve.size:
        at = np.interp(measured[STRAIN].values, curve[STRAIN], curve, left=np.nan, right=np.nan)
    if name != "capacitance_ratio":
        return at, values, measured.get(f"{name}_error", unknown).values
    errors = measured.get("capacitance_error", unknown).values * values
    first = next(iter(np.flatnonzero(np.isfinite(at) & np.isfinite(values))), None)
    if first is None:
        return at, values, errors
    return at / at[first], values / values[first], errors / values[first]
