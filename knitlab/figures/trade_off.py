"""The trade-off front: designs that no other beats in two figures at once."""

import numpy as np
import xarray as xr

from knitlab.io.design_status import Status
from knitlab.io.schema import DESIGN_DIMS

Design = tuple[int, int]


def figures_of(cube: xr.Dataset, *names: str) -> dict[Design, tuple[float, ...]]:
    """Some figures of every design (n_stripe, n_subunit) that is ok and has all of them."""
    designs = cube[["status", *names]].stack(design=DESIGN_DIMS)
    found = {}
    for k, (n_stripe, n_subunit) in enumerate(designs["design"].values):
        values = tuple(float(designs[name][k]) for name in names)
        if int(designs["status"][k]) == Status.ok and np.isfinite(values).all():
            found[int(n_stripe), int(n_subunit)] = values
    return found


def trade_off_front(figures: dict[Design, tuple[float, ...]]) -> list[Design]:
    """The designs of which no other has more of one figure and no less of the others.

    Args:
        figures: of every design; more is better.

    Returns:
        The designs, by the first figure, the largest first.
    """
    front = [
        design
        for design, its in figures.items()
        if not any(_beats(other, its) for other in figures.values())
    ]
    return sorted(front, key=lambda design: figures[design], reverse=True)


def _beats(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    pairs = list(zip(one, other, strict=True))
    return all(a >= b for a, b in pairs) and any(a > b for a, b in pairs)
