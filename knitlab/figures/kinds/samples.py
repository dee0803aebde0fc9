"""Samples between clamps, relaxed and stretched (paper, Fig. "tension images")."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.kinds.tension import PAPER_DESIGNS, shown_strain
from knitlab.figures.plan_view import draw_faces, faces_of, shaded
from knitlab.figures.style import TWO_COLUMNS
from knitlab.figures.value_colours import ValueColours
from knitlab.io.errors import fault

MOST_STRAINS = 2
"""Largest number of states of a sample that are shown."""
MARGIN = 1.1
"""Width and height of a panel over those of what it shows."""
DRAWN, TEXT = 0.75, 1.3
"""Part of the width that the panels take, and height of the text above and below [in]."""


def stretched_samples(cases: Sequence[xr.Dataset]) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Each is shown relaxed and at the recorded strain nearest 0.23, or at one or two selected values
    of ``applied_strain``, all at one scale. Shading is
    slope; colour is the local transverse strain of the unit cell.

    Args:
        cases: contents of case files, with node positions.

    Raises:
        BadInput: if they are not samples between clamps.
    """
    if any("length_x" in case for case in cases):
        problem = "shows samples between clamps, not periodic fabric; draw shape or shapes"
        raise fault("samples", problem)
    selected = cases[0]["applied_strain"].values
    if len(selected) > MOST_STRAINS:
        selected = np.array([0.0, shown_strain(cases[0])])
    shown = [case.sel(applied_strain=selected) for case in cases]
    strains = np.concatenate([case["strain_xx"].values.ravel() for case in shown])
    by_strain = ValueColours.of(strains, signed=True)

    panels = [
        (case, nodes, field, strain)
        for case in shown
        for nodes, field, strain in zip(
            case["position"].values, case["strain_xx"].values, selected, strict=True
        )
    ]
    spans = [MARGIN * np.ptp(nodes[..., :2], axis=(0, 1)) for _, nodes, _, _ in panels]
    widths, tallest = [width for width, _ in spans], max(height for _, height in spans)
    figure = Figure(
        figsize=(TWO_COLUMNS, DRAWN * TWO_COLUMNS * tallest / sum(widths) + TEXT),
        layout="constrained",
    )
    grid = figure.subplots(1, len(panels), squeeze=False, sharey=True, width_ratios=widths)[0]
    for axes, (case, nodes, field, strain) in zip(grid, panels, strict=True):
        faces = faces_of(nodes - [0, nodes[..., 1].min(), 0])
        colours = by_strain.colours(by_strain.norm(_by_face(case, field)))
        draw_faces(axes, faces, shaded(faces, colours))
        axes.set_title(f"{_name(case)}\n{f'pulled {strain:.0%}' if strain else 'relaxed'}")
        axes.set(xlabel="x [mm]", ylabel="")
    grid[0].set_ylabel("y, warp [mm]")
    by_strain.bar(
        figure,
        list(grid),
        label="local transverse strain $\\varepsilon_{xx}$ [1]\nof a unit cell; shading is slope",
        shrink=0.8,
        aspect=30,
    )
    return figure


def _by_face(case: xr.Dataset, field: np.ndarray) -> np.ndarray:
    """The value of its unit cell for every grid cell, face after face."""
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.pattern import recorded_pattern

    record = json.loads(case.attrs["parameters"])
    sample = recorded_pattern(record)
    patches = record.get("cell_patches") or (len(record["pattern"]), len(record["pattern"][0]))
    rows, columns = (
        np.repeat(np.arange(len(borders[::size]) - 1), np.diff(borders[::size]))
        for borders, size in zip((sample.row_borders, sample.column_borders), patches, strict=True)
    )
    return field[np.ix_(rows, columns)].ravel()


def _name(case: xr.Dataset) -> str:
    cells_y, cells_x = case["strain_xx"].shape[-2:]
    design = f"({int(case['n_stripe'])}, {int(case['n_subunit'])})"
    if "pattern" in case.coords:
        design = str(case["pattern"].item()).replace("_", " ")
    return f"{design}\n{cells_x} × {cells_y} cells"


FIGURE = FigureKind(
    stretched_samples, needs="position", designs=PAPER_DESIGNS, coordinates=("applied_strain",)
)
