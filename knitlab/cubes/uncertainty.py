"""Uncertainty: what the covariance of stripe numbers makes of a cube's quantities, linearly."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.cube_file import parameters_of
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import Status

if TYPE_CHECKING:  # which imports JAX
    from knitlab.model.stripe import Stripe
    from knitlab.model.stripe_covariance import Subject

NUMBERS = ("k_s", "k_t", "theta_0", "period")
"""Uncertain numbers of a stripe."""
PARAMETER = "stripe_parameter"
DEVIATE = "deviate"
CONFIDENCE = 0.95  # of intervals
QUANTITIES = ("poisson_ratio", "reaction_force")
LOWEST = "poisson_ratio_min"
HALFWIDTH = "half the 95 % interval of"
SUBJECT = "uncertainty_of"
"""Attribute that says what is uncertain: a new swatch, or the mean."""
SAME = 1e-5  # relative difference up to which a stripe of a cube is that of a material


@dataclass(frozen=True)
class UncertainStripe:
    """A stripe, and the covariance of relative changes of its :data:`NUMBERS` [1]."""

    stripe: "Stripe"
    covariance: Float[np.ndarray, "4 4"]
    degrees_of_freedom: float = math.inf  # of Student's t


@dataclass(frozen=True)
class Stripes:
    """Uncertain stripes of designs, of a new swatch or of the mean stripe."""

    pair: Callable[[int], tuple[UncertainStripe, UncertainStripe]]  # rib and garter by n_stripe
    subject: "Subject"
    note: str  # which of the two, in a sentence


def slopes(cube: xr.Dataset) -> dict[str, xr.DataArray]:
    """Derivatives of quantities by the logarithms of stripe numbers, missing unless ok.

    The lowest ratio has those of the ratio where it is lowest. InputError if there are none.
    """
    names = [name for name in QUANTITIES if f"{name}_sensitivity" in cube]
    if not names:
        message = "has no sensitivities; run it with sensitivities = true"
        raise invalid("the cube", f"{message}, for which method is equilibrium")
    if parameters_of(cube).get("grading", None) is not None:
        message = "has graded fabric, whose stripes are uncertain one by one"
        raise invalid("the cube", f"{message}; take a pattern with one stripe of each knit")
    ok = cube["status"] == Status.ok
    by_name = {name: cube[f"{name}_sensitivity"].where(ok) for name in names}
    if "poisson_ratio" in by_name and LOWEST in cube:
        at_min = abs(cube[STRAIN] - cube["applied_strain_at_min"]) < 1e-9
        by_name[LOWEST] = by_name["poisson_ratio"].where(at_min).mean(STRAIN)
    return by_name


def root_of_covariance(cube: xr.Dataset, stripes: Stripes) -> tuple[xr.DataArray, xr.DataArray]:
    """L and degrees of freedom of deviates: L Lᵀ is the covariance of stripe numbers.

    InputError if a design has stripes other than these.
    """
    names = [str(name) for name in cube[PARAMETER].values]
    sizes = cube["n_stripe"].values.tolist()
    root = np.zeros((len(sizes), len(names), 2 * len(NUMBERS)))
    freedom = np.full((len(sizes), 2 * len(NUMBERS)), np.inf)
    for row, n in enumerate(sizes):
        designs = cube.sel(n_stripe=n)
        ok = designs["status"] == Status.ok
        for half, uncertain in enumerate(stripes.pair(n) if ok.any() else ()):
            knit = uncertain.stripe.knit
            _check_same(designs, ok, uncertain.stripe)
            of_stripe = matrix_root(uncertain.covariance)
            columns = slice(half * len(NUMBERS), (half + 1) * len(NUMBERS))
            freedom[row, columns] = uncertain.degrees_of_freedom
            for number, of_number in zip(NUMBERS, of_stripe, strict=True):
                if f"{knit}_{number}" in names:
                    root[row, names.index(f"{knit}_{number}"), columns] = of_number
    dims = ("n_stripe", PARAMETER, DEVIATE)
    sized = {"n_stripe": sizes}
    of_deviates = xr.DataArray(freedom, sized, ("n_stripe", DEVIATE))
    return xr.DataArray(root, sized | {PARAMETER: names}, dims), of_deviates


def matrix_root(
    covariance: Float[np.ndarray, "number number"],
) -> Float[np.ndarray, "number number"]:
    """L with L Lᵀ = Σ, also of a singular Σ."""
    variances, directions = np.linalg.eigh(covariance)
    return directions * np.sqrt(np.maximum(variances, 0))


def _check_same(designs: xr.Dataset, ok: xr.DataArray, stripe: "Stripe") -> None:
    for number in NUMBERS:
        name = f"{stripe.knit}_{number}"
        wanted = getattr(stripe, number)
        if name not in designs:
            continue
        values = designs[name].where(ok)
        if (others := values.where(abs(values / wanted - 1) > SAME)).notnull().any():
            given = f"is {float(others.max()):.6g} in the cube, and {wanted:.6g} in the material"
            hint = "run the workflow with this material"
            raise invalid(f"{name} of n_stripe {int(designs['n_stripe'])}", f"{given}; {hint}")


def deviations(cube: xr.Dataset, stripes: Stripes) -> tuple[dict[str, xr.DataArray], xr.DataArray]:
    """Change of each quantity with each deviate of stripe numbers, and their degrees of freedom."""
    by_name = slopes(cube)
    (root, freedom) = root_of_covariance(cube, stripes)
    changes = {name: (slope * root).sum(PARAMETER, skipna=False) for name, slope in by_name.items()}
    return changes, freedom


def interval(
    by_deviate: xr.DataArray, freedom: xr.DataArray
) -> tuple[xr.DataArray, xr.DataArray, xr.DataArray]:
    """Variance, degrees of freedom, and half the 95 % interval of a sum of deviates.

    The degrees of freedom are those of Welch and Satterthwaite, v²/Σ(v_i²/ν_i).
    """
    from scipy import stats  # slow to import

    variance = share = xr.zeros_like(by_deviate.isel({DEVIATE: 0}))
    for first in (0, len(NUMBERS)):
        own = by_deviate.isel({DEVIATE: slice(first, first + len(NUMBERS))})
        of_stripe = (own**2).sum(DEVIATE, skipna=False)
        variance = variance + of_stripe
        share = share + of_stripe**2 / freedom.isel({DEVIATE: first})
    effective = xr.where(share > 0, variance**2 / share.where(share > 0), np.inf)
    effective = effective.where(variance.notnull())
    factor = xr.apply_ufunc(partial(stats.t.ppf, (1 + CONFIDENCE) / 2), effective)
    return variance, effective, factor * variance**0.5


def first_order(cube: xr.Dataset, stripes: Stripes) -> xr.Dataset:
    """Standard deviations to first order, intervals, and the stripe numbers they are due to."""
    by_name: dict[str, xr.DataArray] = {}
    derivatives = slopes(cube)
    root, freedom = root_of_covariance(cube, stripes)
    for name, slope in derivatives.items():
        by_deviate = (slope * root).sum(PARAMETER, skipna=False)
        variance, effective, half = interval(by_deviate, freedom)
        with_number = (by_deviate * root).sum(DEVIATE, skipna=False)
        both = (root**2).sum(DEVIATE) * variance
        explained = (with_number**2 / both.where(both > 0)).where((both > 0) | both.isnull(), 0.0)
        by_name[f"{name}_sd"] = with_label(variance**0.5, cube[name])
        by_name[f"{name}_halfwidth"] = with_label(half, cube[name], HALFWIDTH)
        by_name[f"{name}_degrees_of_freedom"] = effective.assign_attrs(
            units="1", long_name="degrees of freedom of Student's t"
        )
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
    variables = {name: each.transpose(*dims, ...) for name, each in (kept | by_name).items()}
    return xr.Dataset(variables, attrs={SUBJECT: stripes.subject, "comment": stripes.note})


def with_label(
    deviation: xr.DataArray, of: xr.DataArray, what: str = "standard deviation of"
) -> xr.DataArray:
    """A deviation in the unit of its quantity, with a label."""
    label = f"{what} {of.attrs.get('long_name', of.name)}"
    return deviation.assign_attrs(units=of.attrs.get("units", "1"), long_name=label)


def leading(parts: xr.DataArray) -> xr.DataArray:
    """The name of the parameter with the largest part, empty where none is known."""
    filled = parts.fillna(0)
    names = filled[PARAMETER].astype(object)[filled.argmax(PARAMETER)].drop_vars(PARAMETER)
    label = "number to measure better, as it explains most of the variance"
    return names.where(filled.max(PARAMETER) > 0, "").assign_attrs(long_name=label)
