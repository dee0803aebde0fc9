"""Uncertainty: what the covariance of stripe numbers makes of a cube's quantities, linearly."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cube.cube_file import parameters_of
from knitlab.cube.schema import STRAIN, Status
from knitlab.io.errors import fault

if TYPE_CHECKING:  # which imports JAX
    from knitlab.fabric.stripe import Stripe

NUMBERS = ("k_s", "k_t", "theta_0", "period")
"""Uncertain numbers of a stripe."""
PARAMETER = "stripe_parameter"
DEVIATE = "deviate"
QUANTITIES = ("poisson_ratio", "reaction_force")
LOWEST = "poisson_ratio_min"
SAME = 1e-5  # relative difference up to which a stripe of a cube is that of a material


@dataclass(frozen=True)
class UncertainStripe:
    """A stripe, and the covariance of relative changes of its :data:`NUMBERS` [1]."""

    stripe: "Stripe"
    covariance: Float[np.ndarray, "4 4"]


Stripes = Callable[[int], tuple[UncertainStripe, UncertainStripe]]
"""Rib and garter of the designs with this ``n_stripe``; BadInput if there is none."""


def slopes(cube: xr.Dataset) -> dict[str, xr.DataArray]:
    """Derivatives of quantities by the logarithms of stripe numbers, missing unless ok.

    The lowest ratio has those of the ratio where it is lowest. BadInput if there are none.
    """
    names = [name for name in QUANTITIES if f"{name}_sensitivity" in cube]
    if not names:
        problem = "has no sensitivities; run it with sensitivities = true"
        raise fault("the cube", f"{problem}, for which method is equilibrium")
    if parameters_of(cube).get("grading", None) is not None:
        problem = "is of graded fabric, whose stripes are uncertain one by one"
        raise fault("the cube", f"{problem}; take a pattern with one stripe of each knit")
    ok = cube["status"] == Status.ok
    by_name = {name: cube[f"{name}_sensitivity"].where(ok) for name in names}
    if "poisson_ratio" in by_name and LOWEST in cube:
        at_min = abs(cube[STRAIN] - cube["applied_strain_at_min"]) < 1e-9
        by_name[LOWEST] = by_name["poisson_ratio"].where(at_min).mean(STRAIN)
    return by_name


def root_of_covariance(cube: xr.Dataset, stripes: Stripes) -> xr.DataArray:
    """L, along n_stripe, parameter and deviate: L Lᵀ is the covariance of stripe numbers.

    Deviates are independent, of unit variance. BadInput if a design has stripes other than these.
    """
    names = [str(name) for name in cube[PARAMETER].values]
    sizes = cube["n_stripe"].values.tolist()
    root = np.zeros((len(sizes), len(names), 2 * len(NUMBERS)))
    for row, n in enumerate(sizes):
        designs = cube.sel(n_stripe=n)
        ok = designs["status"] == Status.ok
        for half, uncertain in enumerate(stripes(n) if ok.any() else ()):
            knit = uncertain.stripe.knit
            _check_same(designs, ok, uncertain.stripe)
            variances, directions = np.linalg.eigh(uncertain.covariance)
            of_stripe = directions * np.sqrt(np.maximum(variances, 0))
            columns = slice(half * len(NUMBERS), (half + 1) * len(NUMBERS))
            for number, of_number in zip(NUMBERS, of_stripe, strict=True):
                if f"{knit}_{number}" in names:
                    root[row, names.index(f"{knit}_{number}"), columns] = of_number
    dims = ("n_stripe", PARAMETER, DEVIATE)
    return xr.DataArray(root, {"n_stripe": sizes, PARAMETER: names}, dims)


def _check_same(designs: xr.Dataset, ok: xr.DataArray, stripe: "Stripe") -> None:
    for number in NUMBERS:
        name, wanted = f"{stripe.knit}_{number}", getattr(stripe, number)
        if name not in designs:
            continue
        values = designs[name].where(ok)
        if (others := values.where(abs(values / wanted - 1) > SAME)).notnull().any():
            given = f"is {float(others.max()):.6g} in the cube, and {wanted:.6g} in the material"
            remedy = "run the workflow with this material"
            raise fault(f"{name} of n_stripe {int(designs['n_stripe'])}", f"{given}; {remedy}")


def deviations(cube: xr.Dataset, stripes: Stripes) -> dict[str, xr.DataArray]:
    """Change of each quantity with each of the independent deviates of stripe numbers."""
    by_name, root = slopes(cube), root_of_covariance(cube, stripes)
    return {name: (slope * root).sum(PARAMETER, skipna=False) for name, slope in by_name.items()}


def uncertainty_of(cube: xr.Dataset, stripes: Stripes) -> xr.Dataset:
    """Standard deviations to first order, and the stripe numbers that they are due to.

    BadInput if the cube has no sensitivities, or designs with stripes other than these.
    """
    by_name: dict[str, xr.DataArray] = {}
    derivatives, root = slopes(cube), root_of_covariance(cube, stripes)
    for name, slope in derivatives.items():
        by_deviate = (slope * root).sum(PARAMETER, skipna=False)
        variance = (by_deviate**2).sum(DEVIATE, skipna=False)
        with_number = (by_deviate * root).sum(DEVIATE, skipna=False)
        both = (root**2).sum(DEVIATE) * variance
        explained = (with_number**2 / both.where(both > 0)).where((both > 0) | both.isnull(), 0.0)
        by_name[f"{name}_sd"] = with_label(variance**0.5, cube[name])
        share = slope * with_number / variance.where(variance > 0)
        by_name[f"{name}_share"] = share.assign_attrs(
            units="1",
            long_name="share in the variance; all sum to 1, correlated ones may be below 0",
        )
        by_name[f"{name}_explained"] = explained.assign_attrs(
            units="1", long_name="part of the variance that knowing this number exactly removes"
        )
        by_name[f"{name}_leading"] = leading(explained)
    kept = {name: cube[name] for name in ("status", LOWEST, *QUANTITIES) if name in cube}
    dims = cube["status"].dims
    return xr.Dataset({name: each.transpose(*dims, ...) for name, each in (kept | by_name).items()})


def with_label(deviation: xr.DataArray, of: xr.DataArray) -> xr.DataArray:
    """A standard deviation in the unit of its quantity, with a label."""
    label = f"standard deviation of {of.attrs.get('long_name', of.name)}"
    return deviation.assign_attrs(units=of.attrs.get("units", "1"), long_name=label)


def leading(parts: xr.DataArray) -> xr.DataArray:
    """The name of the parameter with the largest part, empty where none is known."""
    filled = parts.fillna(0)
    names = filled[PARAMETER].astype(object)[filled.argmax(PARAMETER)].drop_vars(PARAMETER)
    label = "number to measure better: the one that explains most of the variance"
    return names.where(filled.max(PARAMETER) > 0, "").assign_attrs(long_name=label)
