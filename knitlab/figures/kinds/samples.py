"""Samples between clamps, relaxed and stretched (paper, Fig. "tension images")."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.kinds.tension import PAPER_DESIGNS, shown_strain
from knitlab.figures.sheets import draw_faces, faces_of, shaded, state_text
from knitlab.figures.style import TWO_COLUMNS, ValueColours
from knitlab.io.errors import fault

MOST_STRAINS = 2
"""Largest number of states of a sample that are shown."""
MARGIN = 1.1
"""Width and height of a panel over those of what it shows."""
DRAWN, TEXT = 0.75, 1.3
"""Fraction of the width that the panels take, and height of the text above and below [in]."""


def stretched_samples(cases: Sequence[xr.Dataset]) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Each is shown relaxed and at the recorded strain nearest 0.23, or at one or two selected values
    of ``applied_strain``, all at one scale. Shading is
    slope; colour is the local transverse strain of the unit cell.
    """
    if any("length_x" in case for case in cases):
        raise fault("samples", "shows samples between clamps, not periodic fabric; draw shape")
    strains = cases[0]["applied_strain"].values
    if len(strains) > MOST_STRAINS:
        strains = np.array([0.0, shown_strain(cases[0])])
    states = [case.sel(applied_strain=strain) for case in cases for strain in strains]
    local_strains = np.concatenate([state["strain_xx"].values.ravel() for state in states])
    by_strain = ValueColours.of(local_strains, signed=True)
    spans = [np.ptp(state["position"].values[..., :2], axis=(0, 1)) for state in states]
    widths, heights = MARGIN * np.transpose(spans)
    height = DRAWN * TWO_COLUMNS * heights.max() / widths.sum() + TEXT
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    grid = figure.subplots(1, len(states), squeeze=False, sharey=True, width_ratios=widths)[0]
    for axes, state in zip(grid, states, strict=True):
        nodes = state["position"].values
        faces = faces_of(nodes - [0, nodes[..., 1].min(), 0])
        colours = by_strain.colours(by_strain.norm(_by_face(state)))
        draw_faces(axes, faces, shaded(faces, colours))
        axes.set_title(f"{_name(state)}\n{state_text(float(state['applied_strain']))}")
        axes.set(xlabel="x [mm]", ylabel="")
    grid[0].set_ylabel("y, warp [mm]")
    label = "local transverse strain $\\varepsilon_{xx}$ [1]\nof a unit cell; shading is slope"
    by_strain.bar(figure, list(grid), label=label, shrink=0.8, aspect=30)
    return figure


def _by_face(state: xr.Dataset) -> np.ndarray:
    """The strain of its unit cell for every grid cell, face after face."""
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.pattern import recorded_pattern

    record = json.loads(state.attrs["parameters"])
    sample = recorded_pattern(record)
    patches = record.get("cell_patches") or (len(record["pattern"]), len(record["pattern"][0]))
    rows, columns = (
        np.repeat(np.arange(len(borders[::size]) - 1), np.diff(borders[::size]))
        for borders, size in zip((sample.row_borders, sample.column_borders), patches, strict=True)
    )
    return state["strain_xx"].values[np.ix_(rows, columns)].ravel()


def _name(case: xr.Dataset) -> str:
    cells_y, cells_x = case["strain_xx"].shape
    design = f"({int(case['n_stripe'])}, {int(case['n_subunit'])})"
    if "pattern" in case.coords:
        design = str(case["pattern"].item()).replace("_", " ")
    return f"{design}\n{cells_x} × {cells_y} cells"


FIGURE = FigureKind(
    stretched_samples, needs="position", designs=PAPER_DESIGNS, coordinates=("applied_strain",)
)
