"""Probabilities that uncertain designs meet targets, by samples of what is linear in deviates."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float

from knitlab.cube.strain_window import REDUCTIONS
from knitlab.cube.target import Target
from knitlab.cube.uncertainty import DEVIATE, NUMBERS, Stripes, deviations
from knitlab.io.errors import fault

LOG2_SAMPLES = 13  # of the deviates of a design
DEVIATES = 2 * len(NUMBERS)


def with_deviations(cubes: Sequence[xr.Dataset], stripes: Stripes) -> list[xr.Dataset]:
    """Cubes with the change of each quantity with each deviate, as variables of their own."""
    return [
        cube.assign(
            {
                column(name, number): each.isel({DEVIATE: number}).transpose(*cube[name].dims)
                for name, each in deviations(cube, stripes).items()
                for number in range(DEVIATES)
            }
        )
        for cube in cubes
    ]


def column(name: str, deviate: int) -> str:
    """The variable with the change of a quantity with a deviate."""
    return f"{name}_deviate_{deviate}"


def check_tolerance(target: Target) -> None:
    """BadInput for a single value or curve without a tolerance, which no design meets exactly."""
    if (target.curve is not None or target.low == target.high) and target.tolerance is None:
        problem = "is one value, which is met with probability 0; add a tolerance, as in ± 0.02"
        raise fault(f"target {target.text}", problem)


@cache
def _deviates() -> Float[np.ndarray, "sample deviate"]:
    """Independent normal numbers that fill space evenly, always the same."""
    from scipy.stats import norm, qmc

    uniform = qmc.Sobol(DEVIATES, rng=np.random.default_rng(0)).random_base2(LOG2_SAMPLES)
    return norm.ppf(uniform)


def is_met(
    target: Target,
    at: Float[np.ndarray, " point"],
    values: Float[np.ndarray, "design strain"],
    changes: Float[np.ndarray, "deviate design strain"],
) -> np.ndarray:
    """Whether samples of designs (design, sample) meet a target at its strains; NaN if unknown."""
    met = np.empty((len(values), 2**LOG2_SAMPLES))
    for row, curve in enumerate(values):
        sampled = curve + _deviates() @ changes[:, row]
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
