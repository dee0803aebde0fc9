"""Comparison: differences between a simulation and experiments, curve by curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cube.common_settings import parameters_of
from knitlab.cube.cube_file import is_measured, source_of, swept_dims
from knitlab.cube.schema import CYCLE, DESIGN_DIMS, RUN, VARIABLES, Status
from knitlab.cube.selection import choices
from knitlab.io.errors import fault

COMPARED = (
    "mean_strain_xx",
    "mean_strain_yy",
    "poisson_ratio",
    "reaction_force",
    "capacitance_ratio",
)
"""Curves along the applied strain that can be compared."""


@dataclass(frozen=True)
class CurveDifference:
    """The difference between two curves.

    Attributes:
        strains: number of strains at which they are compared.
        rms: root mean square difference.
        uncertainty: its standard error, from the errors of the measured curve.
        noise: RMS difference that these errors would cause for equal curves.
    """

    strains: int
    rms: float
    uncertainty: float
    noise: float


def difference(
    simulated: np.ndarray, measured: np.ndarray, errors: np.ndarray
) -> CurveDifference | None:
    """The difference of two curves at the same strains; ``None`` if they have no strain in common.

    Errors are assumed independent between strains, and 0 where unknown; if all are unknown, so is
    the uncertainty.

    Args:
        simulated: simulated values, NaN where missing.
        measured: measured values, NaN where missing.
        errors: standard errors of the measured values.
    """
    both = np.isfinite(simulated) & np.isfinite(measured)
    count = int(both.sum())
    if not count:
        return None
    deviation, error = (simulated - measured)[both], errors[both]
    rms = float(np.sqrt((deviation**2).mean()))
    if np.isnan(error).all():
        return CurveDifference(count, rms, np.nan, np.nan)
    error = np.nan_to_num(error)
    noise = float(np.sqrt((error**2).mean()))
    # Near 0 the root is not linear in the errors, and is bounded by the errors themselves.
    by_slope = np.sqrt((deviation**2 * error**2).sum()) / (count * rms) if rms > noise else noise
    return CurveDifference(count, rms, float(by_slope), noise)


def compared(simulation: xr.Dataset, experiments: Sequence[xr.Dataset]) -> pd.DataFrame:
    """Differences of every curve of every design that a simulation and an experiment both have.

    The simulation is interpolated linearly to the measured strains, and its force is scaled to the
    number of unit cells across the measured sample. Capacitances, which depend on the length of the
    electrodes, are normalised at the first common strain.

    Returns:
        One row for each curve: source, number of strains, RMS difference, its uncertainty, the
        noise, and the largest measured value, in the unit of the variable.

    Raises:
        BadInput: if the cubes are not one simulation and experiments, have swept settings, or have
            no curve of a design in common.
    """
    _check(simulation, experiments)
    simulation = simulation.isel(dict.fromkeys(swept_dims(simulation), 0), drop=True)
    rows = []
    for experiment in experiments:
        across = parameters_of(experiment)["unit_cells"][1]
        for cell in _measured_cells(experiment):
            labels = {dim: int(cell[dim]) for dim in DESIGN_DIMS}
            if any(label not in simulation[dim].values for dim, label in labels.items()):
                continue
            other = simulation.sel(labels)
            if int(other["status"]) not in RUN:
                continue
            for name in COMPARED:
                scale = across / _cells_across(other) if name == "reaction_force" else 1.0
                rows += _row(name, other, scale, cell, source_of(experiment))
    if not rows:
        raise fault(
            "compare", "no curve of a design is both simulated and measured; choose other cubes"
        )
    return pd.DataFrame(rows)


def _check(simulation: xr.Dataset, experiments: Sequence[xr.Dataset]) -> None:
    if is_measured(simulation):
        name = source_of(simulation)
        raise fault("compare", f"begins with a simulation, but {name} was measured")
    for experiment in experiments:
        if not is_measured(experiment):
            raise fault("compare", "takes one simulation, and experiments after it")
    swept = [dim for dim in swept_dims(simulation) if simulation.sizes[dim] > 1]
    if swept:
        raise fault(
            "compare", f"takes one value of each setting; select {choices(simulation, swept)}"
        )


def _measured_cells(experiment: xr.Dataset) -> list[xr.Dataset]:
    """Every design of an experiment, in every cycle."""
    stacked = experiment.stack(cell=experiment["status"].dims)
    cells = [stacked.isel(cell=place) for place in range(stacked.sizes["cell"])]
    return [cell for cell in cells if int(cell["status"]) == Status.ok]


def _cells_across(cell: xr.Dataset) -> int:
    """Number of unit cells across a simulated sample."""
    return int(cell["strain_yy"].notnull().any(["applied_strain", "cell_y"]).sum())


def _row(
    name: str, simulated: xr.Dataset, scale: float, measured: xr.Dataset, source: str
) -> list[dict[str, object]]:
    """The row of a variable, if both have it."""
    if name not in simulated or name not in measured:
        return []
    curve = simulated[name].dropna("applied_strain")
    if not curve.size:
        return []
    values = measured[name].values
    at = np.interp(
        measured["applied_strain"].values,
        curve["applied_strain"].values,
        scale * curve.values,
        left=np.nan,
        right=np.nan,
    )
    errors = _errors(name, measured)
    both = np.flatnonzero(np.isfinite(at) & np.isfinite(values))
    if name == "capacitance_ratio" and len(both):
        first = both[0]
        at, values, errors = at / at[first], values / values[first], errors / values[first]
    found = difference(at, values, errors)
    if found is None:
        return []
    labels = {dim: int(measured[dim]) for dim in (*DESIGN_DIMS, CYCLE) if dim in measured.coords}
    return [
        {
            "source": source,
            **labels,
            "variable": name,
            "strains": found.strains,
            "rms_difference": found.rms,
            "uncertainty": found.uncertainty,
            "noise": found.noise,
            "largest_measured": float(np.nanmax(np.abs(values))),
            "units": VARIABLES[name].units,
        }
    ]


def _errors(name: str, cell: xr.Dataset) -> np.ndarray:
    """Standard errors of a measured curve; NaN if unknown."""
    values = cell[name].values
    if name == "capacitance_ratio" and "capacitance_error" in cell:
        return np.asarray(cell["capacitance_error"].values * values)
    known = f"{name}_error" in cell
    return np.asarray(cell[f"{name}_error"].values) if known else np.full(values.shape, np.nan)
