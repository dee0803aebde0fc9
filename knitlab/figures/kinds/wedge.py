"""The wedge integral against boundary elements: where the fast estimate is good enough."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cube.cube_file import base_dims
from knitlab.cube.schema import DESIGN_DIMS
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import ONE_COLUMN, SEQUENCE_COLOURS
from knitlab.io.errors import fault

MARKERS = "osD^vP*X"
GOOD = 0.1
"""Shaded difference, which is small enough for a first choice of designs."""
HEIGHT = 2.8
"""Height of the figure [in]."""


def wedge_figure(cubes: Sequence[xr.Dataset]) -> Figure:
    """The fast wedge estimate of a capacitance against boundary elements.

    Shows the relative difference against the fold angle at the electrodes; every point is a state
    of a design during loading.

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
    axes.axhspan(-GOOD, GOOD, color="0.92", zorder=0, label=f"within ±{GOOD:.0%}")
    axes.axhline(0, color="0.6", lw=0.6, zorder=0)
    axes.yaxis.set_major_formatter(mpl.ticker.PercentFormatter(1.0, decimals=0))
    axes.set(
        xlabel="mean fold angle at and between the electrodes [°]",
        ylabel="wedge integral beyond\nboundary elements",
    )
    figure.legend(loc="outside upper center", ncols=3, frameon=False, markerscale=2)
    return figure


def _families(cube: xr.Dataset) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, fold angles and relative differences of the designs of each n_stripe, or knit."""
    if not {"capacitance", "capacitance_wedge", "fold_between"} <= set(cube.data_vars):
        return []
    along = "n_stripe" if base_dims(cube) == DESIGN_DIMS else "knit"
    found = []
    for label in cube[along].values:
        family = cube.sel({along: label})
        excess = (family["capacitance_wedge"] / family["capacitance"] - 1).values
        kept = np.isfinite(excess)
        if kept.any():
            name = f"n_stripe = {label}" if along == "n_stripe" else f"pure {label}"
            found.append((name, family["fold_between"].values[kept], excess[kept]))
    return found


FIGURE = FigureKind(wedge_figure, dims=None, several="any")
