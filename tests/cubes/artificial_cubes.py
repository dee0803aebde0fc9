"""An artificial cube with one design of every status, for tests without simulation."""

import numpy as np
import xarray as xr

from knitlab.observables.schema import described
from knitlab.observables.status import Status

STRAINS = [0.0, 0.1, 0.2]
LOWEST = {(2, 16): 0.05, (4, 16): -0.8, (4, 32): -0.4}
STATUS = {
    (2, 16): Status.ok,
    (2, 32): Status.failed,
    (4, 16): Status.ok,
    (4, 32): Status.ok,
    (8, 16): Status.excluded,
    (8, 32): Status.not_converged,
    (2, 64): Status.pending,
    (4, 64): Status.excluded,
    (8, 64): Status.excluded,
}
N_STRIPE, N_SUBUNIT = [2, 4, 8], [16, 32, 64]


PARAMETERS = ["rib_k_s", "rib_k_t", "garter_k_s", "garter_k_t"]


def synthetic_cube(sensitivities: bool = False) -> xr.Dataset:
    grid = [[(n, m) for m in N_SUBUNIT] for n in N_STRIPE]
    status = np.array([[STATUS[pair] for pair in row] for row in grid], dtype=np.int8)
    lowest = np.array([[LOWEST.get(pair, np.nan) for pair in row] for row in grid])
    periods = np.array([[m / (2 * n) for n, m in row] for row in grid])
    curve = lowest[..., None] * np.array([np.nan, 1.0, 0.5])
    curve[2, 1] = [np.nan, -0.3, np.nan]
    axial = np.broadcast_to(STRAINS, curve.shape).copy()
    axial[np.isnan(curve) & (np.arange(3) > 0)] = np.nan
    designs = ("n_stripe", "n_subunit")
    states = (*designs, "applied_strain")
    cube = described(
        xr.Dataset(
            {
                "status": (designs, status),
                "case_id": (designs, [[f"{n}-{m}-0" for n, m in row] for row in grid]),
                "periods": (designs, np.where(status == Status.excluded, np.nan, periods)),
                "poisson_ratio_min": (designs, lowest),
                "applied_strain_at_min": (designs, np.where(np.isnan(lowest), np.nan, 0.1)),
                "poisson_ratio": (states, curve),
                "mean_strain_yy": (states, axial),
                "mean_strain_xx": (states, -np.nan_to_num(curve) * axial),
            },
            {"n_stripe": N_STRIPE, "n_subunit": N_SUBUNIT, "applied_strain": STRAINS},
        )
    )
    if sensitivities:
        shares = xr.DataArray([1.0, 2.0, -0.5, 0.0], {"stripe_parameter": PARAMETERS})
        cube["poisson_ratio_sensitivity"] = cube["poisson_ratio"] * shares
    return cube
