"""Pareto fronts: what nothing else dominates."""

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from knitlab.cube.schema import DESIGN_DIMS, Status

Design = tuple[int, int]


def values_of_designs(cube: xr.Dataset, *names: str) -> dict[Design, tuple[float, ...]]:
    """Values of some variables, by design; only of designs that are ok and have all of them."""
    designs = cube[["status", *names]].stack(design=DESIGN_DIMS)
    found = {}
    for k, (n_stripe, n_subunit) in enumerate(designs["design"].values):
        values = tuple(float(designs[name][k]) for name in names)
        if int(designs["status"][k]) == Status.ok and np.isfinite(values).all():
            found[int(n_stripe), int(n_subunit)] = values
    return found


def pareto_front(values: dict[Design, tuple[float, ...]]) -> list[Design]:
    """The designs that no other dominates, that is, equals in all values and exceeds in one.

    Args:
        values: values of every design; larger is better.

    Returns:
        The designs, in descending order of the first value.
    """
    if not values:
        return []
    on_front = non_dominated(-np.array(list(values.values())))
    front = [design for design, kept in zip(values, on_front, strict=True) if kept]
    return sorted(front, key=lambda design: values[design], reverse=True)


def non_dominated(losses: Float[np.ndarray, "point loss"]) -> Bool[np.ndarray, " point"]:
    """Whether no other point dominates a point: no larger in any loss, and smaller in one."""
    own, other = losses[:, None], losses[None]
    dominated = np.all(other <= own, axis=2) & np.any(other < own, axis=2)
    return np.logical_not(dominated.any(axis=1))
