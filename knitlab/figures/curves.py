"""Curves over the applied strain: dashed if measured, broken where the fabric snaps."""

from collections.abc import Iterable

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from matplotlib.lines import Line2D

from knitlab.cube.cube_file import is_measured

BREAK = "break: the fabric snaps there"


def line_style(cube: xr.Dataset) -> str:
    """Line style of a cube: dashed if it is measured, as in the paper."""
    return "--" if is_measured(cube) else "-"


def snapped_before(design: xr.Dataset) -> Bool[np.ndarray, " strain"]:
    """Whether a design snapped on the way to each applied strain; nowhere if it is not recorded."""
    if "snapped" not in design:
        return np.zeros(design.sizes["applied_strain"], bool)
    return np.asarray(design["snapped"].values == 1)


def broken(
    snapped: Bool[np.ndarray, " strain"], *curves: Float[np.ndarray, " strain"]
) -> list[Float[np.ndarray, " point"]]:
    """Curves with a missing value before every strain on the way to which the fabric snapped.

    Drawn as a line they break there: what lies between was not an equilibrium.
    """
    before = np.flatnonzero(snapped)
    before = before[before > 0]
    return [np.insert(np.asarray(curve, float), before, np.nan) for curve in curves]


def break_note(designs: Iterable[xr.Dataset]) -> list[Line2D]:
    """Legend entry of the breaks, if there are any."""
    if not any(snapped_before(design)[1:].any() for design in designs):
        return []
    # A piece of line, a gap and a piece of line in the width of a handle.
    return [Line2D([], [], color="0.3", ls=(0, (4.2, 3.3)), label=BREAK)]
