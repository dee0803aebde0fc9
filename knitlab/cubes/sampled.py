"""Statistics of a cube along samples of its stripe numbers: deviations, and Sobol indices."""

import numpy as np
import xarray as xr

from knitlab.cubes.cube_file import design_dims
from knitlab.cubes.uncertainty import (
    HALFWIDTH,
    LOWEST,
    NUMBERS,
    PARAMETER,
    QUANTITIES,
    with_label,
)
from knitlab.observables.schema import SAMPLE, STRAIN
from knitlab.observables.status import Status

MIN_SAMPLES = 40
"""Samples from which on the ends of a 95 % interval lie within them."""
TAILS = [0.025, 0.975]
STRIPE_NUMBERS = [f"{knit}_{name}" for knit in ("rib", "garter") for name in NUMBERS]


def sampled_uncertainty(cube: xr.Dataset) -> xr.Dataset:
    """Mean and standard deviation of every variable over the samples; see `kl.uncertainty`."""
    ok = cube["status"] == Status.ok
    design = saltelli_design(cube)
    count = cube.sizes[SAMPLE] if design is None else 2 * design[1]
    # Beyond the first two parts of a design by Saltelli samples are not independent.
    independent = cube.where(ok).isel({SAMPLE: slice(count)})
    variables = {"samples": independent["status"].count(SAMPLE)}
    within = {*design_dims(cube), STRAIN}
    for name, each in independent.data_vars.items():
        known = {SAMPLE} <= {*each.dims} <= within and name not in ("status", *STRIPE_NUMBERS)
        if known and each.dtype.kind == "f":
            variables[f"{name}_mean"] = each.mean(SAMPLE).assign_attrs(cube[name].attrs)
            variables[f"{name}_sd"] = with_label(each.std(SAMPLE, ddof=1), cube[name])
            if count >= MIN_SAMPLES:
                ends = each.quantile(TAILS, SAMPLE).diff("quantile").isel(quantile=0, drop=True)
                variables[f"{name}_halfwidth"] = with_label(ends / 2, cube[name], HALFWIDTH)
    if design is not None:
        for name in (LOWEST, *QUANTITIES):
            if name in cube:
                variables |= _indices(cube[name].where(ok), *design)
    return xr.Dataset(variables)


def saltelli_design(cube: xr.Dataset) -> tuple[list[str], int] | None:
    """Numbers that were sampled as for Sobol indices, and rows of each part; else None."""
    by_sample = {
        name: cube[name].max([dim for dim in cube[name].dims if dim != SAMPLE]).values
        for name in STRIPE_NUMBERS
        if name in cube and SAMPLE in cube[name].dims
    }
    varied = {name: each for name, each in by_sample.items() if np.ptp(each) > 0}
    rows, left = divmod(cube.sizes[SAMPLE], len(varied) + 2)
    if left or not varied:
        return None
    parts = np.array([*varied.values()]).reshape(len(varied), -1, rows)
    is_own = np.eye(len(varied), dtype=bool)[..., None]
    wanted = np.where(is_own, parts[:, 1, None], parts[:, 0, None])
    return ([*varied], rows) if np.array_equal(parts[:, 2:], wanted) else None


def _indices(values: xr.DataArray, names: list[str], rows: int) -> dict[str, xr.DataArray]:
    """First-order and total Sobol indices of a quantity by stripe parameter."""
    from scipy.stats import sobol_indices

    kept = values.transpose(SAMPLE, ...)
    flat = kept.values.reshape(len(names) + 2, rows, -1).swapaxes(1, 2)
    first, total = np.full((2, flat.shape[1], len(names)), np.nan)
    known = np.isfinite(flat).all(axis=(0, 2)) & (np.ptp(flat, axis=(0, 2)) > 0)
    if known.any():
        a, b, *exchanged = flat[:, known]
        parts = {"f_A": a, "f_B": b, "f_AB": np.array(exchanged)}
        indices = sobol_indices(func=parts, n=rows)
        first[known] = indices.first_order
        total[known] = indices.total_order
    dims = kept.dims[1:]
    coordinates = {dim: kept[dim] for dim in dims} | {PARAMETER: names}

    variables = {}
    for name, each in {"first_order": first, "total": total}.items():
        about = {"units": "1", "long_name": f"{name.replace('_', '-')} Sobol index"}
        shaped = each.reshape(*kept.shape[1:], len(names))
        array = xr.DataArray(shaped, coordinates, (*dims, PARAMETER), attrs=about)
        variables[f"{values.name}_{name}"] = array
    return variables
