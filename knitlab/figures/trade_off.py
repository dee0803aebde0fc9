"""The Pareto front: designs that no other design dominates in two variables."""

import numpy as np
import xarray as xr

from knitlab.io.design_status import Status
from knitlab.io.schema import DESIGN_DIMS

Design = tuple[int, int]


def values_of_designs(cube: xr.Dataset, *names: str) -> dict[Design, tuple[float, ...]]:
    """Some variables of every design (n_stripe, n_subunit) that is ok and has all of them."""
    designs = cube[["status", *names]].stack(design=DESIGN_DIMS)
    found = {}
    for k, (n_stripe, n_subunit) in enumerate(designs["design"].values):
        values = tuple(float(designs[name][k]) for name in names)
        if int(designs["status"][k]) == Status.ok and np.isfinite(values).all():
            found[int(n_stripe), int(n_subunit)] = values
    return found


def pareto_front(values: dict[Design, tuple[float, ...]]) -> list[Design]:
    """The designs that no other design dominates: has more of one value and no less of the others.

    Args:
        values: of every design; more is better.

    Returns:
        The designs, in descending order of the first value.
    """
    front = [
        design
        for design, its in values.items()
        if not any(_dominates(other, its) for other in values.values())
    ]
    return sorted(front, key=lambda design: values[design], reverse=True)


def _dominates(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    pairs = list(zip(one, other, strict=True))
    return all(a >= b for a, b in pairs) and any(a > b for a, b in pairs)
