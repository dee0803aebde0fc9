"""Samples between clamps, relaxed and stretched (paper, Fig. "tension images")."""

import json
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.kinds.tension import PAPER_DESIGNS, shown_strain
from knitlab.figures.relief import draw_relief, faces_of
from knitlab.figures.style import STRAIN_COLOURS, TWO_COLUMNS
from knitlab.io.errors import fault

MARGIN = 1.1
"""Width and height of a panel over those of what it shows."""
DRAWN, TEXT = 0.75, 1.3
"""Part of the width that the panels take, and height of the text above and below [in]."""


def stretched_samples(cases: Sequence[xr.Dataset]) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Each is shown relaxed and at the recorded strain nearest 0.23, all at one scale. Shading is
    slope; colour is the local transverse strain of the unit cell.

    Args:
        cases: contents of case files, with node positions.

    Raises:
        BadInput: if they are not samples between clamps.
    """
    if any("length_x" in case for case in cases):
        problem = "shows samples between clamps, not periodic fabric; draw shape or shapes"
        raise fault("samples", problem)
    stretched = shown_strain(cases[0])
    shown = [case.sel(applied_strain=[0.0, stretched]) for case in cases]
    largest = max(float(np.nanmax(np.abs(case["strain_xx"]))) for case in shown)
    norm = mpl.colors.Normalize(-largest, largest)

    panels = [
        (case, nodes, field, strain)
        for case in shown
        for nodes, field, strain in zip(
            case["position"].values, case["strain_xx"].values, (0.0, stretched), strict=True
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
        colours = mpl.colormaps[STRAIN_COLOURS](norm(_by_face(case, field)))
        draw_relief(axes, faces, colours, np.empty((0, 2, 3)), rasterised=True)
        axes.set_title(f"{_name(case)}\n{f'pulled {strain:.0%}' if strain else 'relaxed'}")
        axes.set(xlabel="x [mm]", ylabel="")
    grid[0].set_ylabel("y, warp [mm]")
    figure.colorbar(
        mpl.cm.ScalarMappable(norm, STRAIN_COLOURS),
        ax=list(grid),
        label="local transverse strain $\\varepsilon_{xx}$ [1]",
        shrink=0.8,
        aspect=30,
    )
    return figure


def _by_face(case: xr.Dataset, field: np.ndarray) -> np.ndarray:
    """The value of its unit cell for every grid cell, face after face."""
    # JAX is imported only when this figure is drawn.
    from knitlab.model.grading import recorded_pattern

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


FIGURE = FigureKind(stretched_samples, needs="position", designs=PAPER_DESIGNS)
