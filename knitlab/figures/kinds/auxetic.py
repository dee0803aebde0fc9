"""The auxetic design map: lowest Poisson's ratio over n_stripe and P."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.cells import (
    DESIGN_NOTE,
    EMPTY,
    PERIODS_LABEL,
    CellStyle,
    draw_cells,
    marks_legend,
    measured_note,
    remove_frame,
    row_count,
    text_note,
    values_of,
)
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import TWO_COLUMNS, number
from knitlab.figures.value_colours import ValueColours
from knitlab.io.errors import fault

LARGE_SPREAD = 0.05
"""Spread of Poisson's ratio over the siblings of a design above which the map states it."""
SPREAD_NOTE = "spread: difference in ν between slightly different fabrics, docs/how-to/spread.md"


def auxetic_map(cubes: Sequence[xr.Dataset]) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain at which it occurs.

    With one applied strain selected, it shows Poisson's ratio there. Designs without a value are
    hatched by status, so that a failure never looks like a value; measured ones have a dashed
    frame. Where ν of the siblings of a design differs by more than 0.05 at any strain, the map
    states the difference.

    Raises:
        BadInput: if no cube has Poisson's ratio.
    """
    if not any("poisson_ratio_min" in cube for cube in cubes):
        raise fault("auxetic", "shows Poisson's ratio, and there is none; import markers")
    strain = _only_strain(cubes)
    name = "poisson_ratio_min" if strain is None else "poisson_ratio"
    if strain is not None:
        cubes = [cube.isel(applied_strain=0) for cube in cubes]
    colours = ValueColours.of(values_of(cubes, name), signed=True)

    def text(value: float, design: xr.Dataset) -> str:
        shown = number(value)
        if strain is None:
            shown += f"\nat {float(design['applied_strain_at_min']):.0%}"
        spread = _spread(design)
        return f"{shown}\nspread {spread:.2f}" if spread > LARGE_SPREAD else shown

    rows = row_count(cubes)
    figure = Figure(figsize=(TWO_COLUMNS, max(2.4, 1.2 + 0.5 * rows)), layout="constrained")
    axes = figure.add_subplot()
    marked, gaps = draw_cells(axes, cubes, CellStyle(name, colours, text))
    axes.set_xlabel(PERIODS_LABEL)
    remove_frame(axes)
    what = "lowest Poisson's ratio ν" if strain is None else f"Poisson's ratio ν at {strain:.0%}"
    colours.bar(figure, axes, pad=0.01, label=f"{what}\n(negative: auxetic)")
    said = "lowest ν, and the applied strain there" if strain is None else "ν"
    notes = [*measured_note(cubes), text_note(f"{DESIGN_NOTE}, {said}")]
    if gaps:
        notes.append(text_note(EMPTY))
    if any(_spread(cube) > LARGE_SPREAD for cube in cubes):
        notes.append(text_note(SPREAD_NOTE))
    marks_legend(figure, marked, notes=notes)
    return figure


def _only_strain(cubes: Sequence[xr.Dataset]) -> float | None:
    """The one applied strain that all cubes hold, if they hold no more."""
    strains = np.unique(np.concatenate([cube["applied_strain"].values for cube in cubes]))
    return float(strains[0]) if len(strains) == 1 and strains[0] > 0 else None


def _spread(cube: xr.Dataset) -> float:
    """Largest spread of ν over siblings, at any strain of any design; NaN without siblings."""
    if "poisson_ratio_low" not in cube:
        return float("nan")
    return float((cube["poisson_ratio_high"] - cube["poisson_ratio_low"]).max())


FIGURE = FigureKind(auxetic_map, several="designs", coordinates=("applied_strain",))
