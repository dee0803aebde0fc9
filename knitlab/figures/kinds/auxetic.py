"""The auxetic design map: lowest Poisson's ratio over n_stripe and P."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.cells import EMPTY, PERIODS_LABEL, draw_map, marks_legend, row_count
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import TWO_COLUMNS, number
from knitlab.io.errors import fault

LARGE_SPREAD = 0.05
"""Spread of Poisson's ratio over the siblings of a design above which the map states it."""
SPREAD_NOTE = "spread: difference in ν between slightly different fabrics, docs/how-to/spread.md"
NO_RATIO = "no ratio: not stretched, or a single clamped cell"


def auxetic_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain at which it occurs.

    With one applied strain selected, it shows Poisson's ratio there. Designs without a value are
    hatched by status, so that a failure never looks like a value; measured ones have a dashed
    frame. Where ν of the siblings of a design differs by more than 0.05 at any strain, the map
    states the difference.
    """
    if not any("poisson_ratio_min" in cube for cube in cubes):
        raise fault("auxetic", "shows Poisson's ratio, and there is none; import markers")
    strains = np.unique(np.concatenate([cube["applied_strain"].values for cube in cubes]))
    lowest = len(strains) > 1 or strains[0] == 0
    if not lowest:
        cubes = [cube.isel(applied_strain=0) for cube in cubes]

    def text(value: float, design: xr.Dataset) -> str:
        shown = number(value)
        if lowest:
            shown += f"\nat {float(design['applied_strain_at_min']):.0%}"
        spread = _spread(design)
        return f"{shown}\nspread {spread:.2f}" if spread > LARGE_SPREAD else shown

    height = max(2.4, 1.2 + 0.5 * row_count(cubes))
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    axes = figure.add_subplot()
    name = "poisson_ratio_min" if lowest else "poisson_ratio"
    label = "lowest Poisson's ratio ν" if lowest else f"Poisson's ratio ν at {strains[0]:.0%}"
    label += "\n(negative: auxetic)"
    marked, gaps = draw_map(figure, axes, cubes, name, label, text, signed=True)
    axes.set_xlabel(PERIODS_LABEL)
    said = "lowest ν, and the applied strain there" if lowest else "ν"
    notes = [f"in each cell: (n_stripe, n_subunit), {said}", *([EMPTY] if gaps else [])]
    if any(_spread(cube) > LARGE_SPREAD for cube in cubes):
        notes.append(SPREAD_NOTE)
    marks_legend(figure, marked, NO_RATIO, notes, cubes)
    return figure


def _spread(cube: xr.Dataset) -> float:
    """Largest spread of ν over siblings, at any strain of any design; NaN without siblings."""
    if "poisson_ratio_low" not in cube:
        return float("nan")
    return float((cube["poisson_ratio_high"] - cube["poisson_ratio_low"]).max())


FIGURE = FigureKind(auxetic_map, several="designs", coordinates=("applied_strain",))
