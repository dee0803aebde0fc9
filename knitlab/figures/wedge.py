"""The wedge integral against boundary elements: where the fast estimate is good enough."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.style import ONE_COLUMN, SEQUENCE_COLOURS
from knitlab.io.cube_file import base_dims
from knitlab.io.errors import fault
from knitlab.io.schema import DESIGN_DIMS

MARKERS = "osD^vP*X"
GOOD = 0.1
"""Difference that is shaded as good enough for a first choice of designs."""
HEIGHT = 2.8
"""Of the figure [in]."""


def wedge_figure(cubes: Sequence[xr.Dataset]) -> Figure:
    """How much more the wedge integral gives, against the fold angle at the electrodes.

    Every point is a state of a design that was measured, on the way up.

    Raises:
        BadInput: if no cube has both capacitances.
    """
    figure = Figure(figsize=(ONE_COLUMN * 1.15, HEIGHT), layout="constrained")
    axes = figure.add_subplot()
    families = [family for cube in cubes for family in _families(cube)]
    if not families:
        raise fault("wedge", "needs electrodes side by side; give cubes of the workflow sensor")
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.85, len(families)))
    for (name, fold, excess), shade, marker in zip(families, shades, MARKERS, strict=False):
        axes.plot(np.degrees(fold), excess, marker, ms=2.5, mew=0, color=shade, label=name)
    axes.axhspan(-GOOD, GOOD, color="0.92", zorder=0)
    axes.axhline(0, color="0.6", lw=0.6, zorder=0)
    axes.yaxis.set_major_formatter(mpl.ticker.PercentFormatter(1.0))
    axes.set(
        xlabel="mean fold angle at and between the electrodes [°]",
        ylabel="wedge integral over\nboundary elements, less one",
    )
    figure.legend(loc="outside upper center", ncols=3, frameon=False, markerscale=2)
    return figure


def _families(cube: xr.Dataset) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Fold angles and excesses of the designs of each n_stripe, or knit."""
    if not {"capacitance", "capacitance_wedge", "fold_between"} <= set(cube.data_vars):
        return []
    along = "n_stripe" if base_dims(cube) == DESIGN_DIMS else "knit"
    found = []
    for label in cube[along].values:
        of = cube.sel({along: label})
        excess = (of["capacitance_wedge"] / of["capacitance"] - 1).values
        kept = np.isfinite(excess)
        if kept.any():
            name = f"n_stripe = {label}" if along == "n_stripe" else f"pure {label}"
            found.append((name, of["fold_between"].values[kept], excess[kept]))
    return found
