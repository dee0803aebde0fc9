"""The auxetic design map: lowest Poisson's ratio over (n_stripe, n_subunit)."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.figures.cells import (
    CellStyle,
    draw_cells,
    frame,
    marks_legend,
    measured_note,
    row_count,
    values_of,
)
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import STRAIN_COLOURS, TWO_COLUMNS
from knitlab.io.errors import fault

LARGE_SPREAD = 0.05
"""Spread of Poisson's ratio over the siblings of a design above which the map states it."""
SPREAD_NOTE = "spread: difference in ν between slightly different fabrics, docs/how-to/spread.md"


def auxetic_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain at which it occurs.

    Designs without a value are hatched by status, so that a failure never looks like a value;
    measured ones have a dashed frame. Where ν of the siblings of a design differs by more than
    0.05 at any strain, the map states the difference.

    Raises:
        BadInput: if no cube has Poisson's ratio.
    """
    if not any("poisson_ratio_min" in cube for cube in cubes):
        raise fault("auxetic", "shows Poisson's ratio, and there is none; import markers")
    # The same colour means the same value in every map, unless one goes beyond ±1.
    largest = float(np.max(np.abs([*values_of(cubes, "poisson_ratio_min"), 1.0])))
    norm = mpl.colors.Normalize(-largest, largest)
    colours = mpl.colormaps[STRAIN_COLOURS]

    def text(value: float, design: xr.Dataset) -> str:
        shown = f"{value:.2f}\nat {float(design['applied_strain_at_min']):.0%}"
        spread = _spread(design)
        return f"{shown}\nspread {spread:.2f}" if spread > LARGE_SPREAD else shown

    style = CellStyle("poisson_ratio_min", lambda value: colours(norm(value)), text)
    rows = row_count(cubes)
    figure = Figure(figsize=(TWO_COLUMNS, max(2.4, 1.1 + 0.5 * rows)), layout="constrained")
    axes = figure.add_subplot()
    marked = draw_cells(axes, cubes, style)
    axes.set_xlabel("n_subunit: stitches along a garter stripe")
    label = "lowest Poisson's ratio\n(negative: auxetic)"
    frame(figure, axes, mpl.cm.ScalarMappable(norm, colours), label=label)
    notes = measured_note(cubes)
    if any(_spread(cube) > LARGE_SPREAD for cube in cubes):
        notes.append(Patch(label=SPREAD_NOTE, facecolor="none", edgecolor="none"))
    marks_legend(figure, marked, notes=notes)
    return figure


def _spread(cube: xr.Dataset) -> float:
    """Largest spread of ν over siblings, at any strain of any design; NaN without siblings."""
    if "poisson_ratio_low" not in cube:
        return float("nan")
    return float((cube["poisson_ratio_high"] - cube["poisson_ratio_low"]).max())


FIGURE = FigureKind(auxetic_map, several="designs")
