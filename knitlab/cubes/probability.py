"""Probabilities that uncertain designs meet targets, by samples of what is linear in deviates.

A linear function of the numbers of stripes follows Student's t; one χ² is common to all functions.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.strain_window import REDUCTIONS
from knitlab.cubes.target import Target
from knitlab.cubes.uncertainty import DEVIATE, NUMBERS, Stripes, deviations
from knitlab.io.errors import invalid

LOG2_SAMPLES = 13  # of the deviates of a design
DEVIATES = 2 * len(NUMBERS)
FREEDOMS = "rib_degrees_of_freedom", "garter_degrees_of_freedom"


def with_deviations(cubes: Sequence[xr.Dataset], stripes: Stripes) -> list[xr.Dataset]:
    """Cubes with the change of each quantity with each deviate and their degrees of freedom."""
    made = []
    for cube in cubes:
        by_name, freedom = deviations(cube, stripes)
        changes = {
            column(name, number): each.isel({DEVIATE: number}).transpose(*cube[name].dims)
            for name, each in by_name.items()
            for number in range(DEVIATES)
        }
        of_designs = freedom.broadcast_like(cube["status"]).transpose(*cube["status"].dims, ...)
        freedoms = {
            name: of_designs.isel({DEVIATE: half * len(NUMBERS)})
            for half, name in enumerate(FREEDOMS)
        }
        made.append(cube.assign(changes | freedoms))
    return made


def freedoms_of(designs: pd.DataFrame) -> Float[np.ndarray, "design 2"]:
    """Degrees of freedom of the deviates of rib and garter of designs."""
    return designs[list(FREEDOMS)].to_numpy(float)


def column(name: str, deviate: int) -> str:
    """The variable with the change of a quantity with a deviate."""
    return f"{name}_deviate_{deviate}"


def check_tolerance(target: Target) -> None:
    """InputError for a single value or curve without a tolerance, which no design meets exactly."""
    if (target.curve is not None or target.low == target.high) and target.tolerance is None:
        message = "is one value, which is met with probability 0; add a tolerance, as in ± 0.02"
        raise invalid(f"target {target.text}", message)


@cache
def _samples() -> tuple[Float[np.ndarray, "sample deviate"], Float[np.ndarray, " sample"]]:
    """Independent normal numbers that fill space evenly, and uniform ones; always the same."""
    from scipy.stats import norm, qmc

    uniform = qmc.Sobol(DEVIATES + 1, rng=np.random.default_rng(0)).random_base2(LOG2_SAMPLES)
    return norm.ppf(uniform[:, :DEVIATES]), uniform[:, DEVIATES]


@cache
def _scale(hundredths: int) -> Float[np.ndarray, " sample"]:
    """What makes Student's t of normal samples, by 100/ν."""
    return chi_scale(_samples()[1], 100 / hundredths if hundredths else np.inf)


def chi_scale(
    uniform: Float[np.ndarray, " sample"], degrees_of_freedom: float
) -> Float[np.ndarray, " sample"]:
    """What normal deviates are multiplied by to be multivariate t: √(ν/χ²), at its quantiles."""
    from scipy.stats import chi2

    if np.isinf(degrees_of_freedom):
        return np.ones_like(uniform)
    return np.sqrt(degrees_of_freedom / chi2.ppf(uniform, degrees_of_freedom))


def _sampled(
    changes: Float[np.ndarray, "deviate strain"], freedoms: Float[np.ndarray, " stripe"]
) -> Float[np.ndarray, "sample strain"]:
    """Samples of a linear function: Student's t by Welch and Satterthwaite, as its interval."""
    of_stripes = (changes**2).reshape(len(freedoms), len(NUMBERS), -1).sum(axis=1)
    square = of_stripes.sum(axis=0) ** 2
    inverse = (of_stripes**2 / freedoms[:, None]).sum(axis=0) / np.where(square > 0, square, 1)
    hundredths = np.rint(100 * np.nan_to_num(inverse)).astype(int)
    scales = np.array([_scale(each) for each in hundredths.tolist()]).T
    return scales * (_samples()[0] @ changes)


def is_met(
    target: Target,
    at: Float[np.ndarray, " point"],
    values: Float[np.ndarray, "design strain"],
    changes: Float[np.ndarray, "deviate design strain"],
    freedoms: Float[np.ndarray, "design 2"],
) -> np.ndarray:
    """Whether samples of designs (design, sample) meet a target at its strains; NaN if unknown."""
    met = np.empty((len(values), 2**LOG2_SAMPLES))
    for row, curve in enumerate(values):
        sampled = curve + _sampled(changes[:, row], freedoms[row])
        if target.reduction is not None:
            sampled = REDUCTIONS[target.reduction](at, sampled)[:, None]
        excess = abs(target.departure(sampled, at))
        met[row] = np.where(
            np.isnan(excess).any(axis=1), np.nan, (excess <= target.allowance).all(axis=1)
        )
    return met


def numbers_of(designs: pd.DataFrame, name: str) -> Float[np.ndarray, "deviate design 1"]:
    """Changes of a variable that is one number of a design; 0 if it has no sensitivities."""
    zero = np.zeros(len(designs))
    changes = [designs.get(column(name, number), zero) for number in range(DEVIATES)]
    return np.array(changes, float)[..., None]
