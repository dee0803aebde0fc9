"""Samples between clamps, relaxed and stretched."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from knitlab.cubes.case_file import length_unit
from knitlab.export.meshes.fabric import on_grid_cells
from knitlab.figures import sheets, style
from knitlab.figures.cells import design_name, pull_note
from knitlab.figures.kinds.tension import PAPER_DESIGNS, SHOWN_STRAIN
from knitlab.figures.registry import figure
from knitlab.figures.style import TWO_COLUMNS, Look
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

MIN_WIDTH = 0.65  # of a panel, for its title [inch]
MAX_HEIGHT = 7.5  # of the figure [inch]


@figure(needs="position", designs=PAPER_DESIGNS, coordinates=(STRAIN,))
def samples(cases: Sequence[xr.Dataset]) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Each is shown relaxed and at the recorded strain nearest 0.23, or at one or two selected values
    of ``applied_strain``.
    """
    from knitlab.cubes.recorded_case import recorded_case

    if any("length_x" in case for case in cases):
        raise invalid("samples", "shows samples between clamps, not periodic fabric; draw shape")
    strains = cases[0]["applied_strain"]
    if len(strains) > 2:
        strains = strains.sel(applied_strain=[0, SHOWN_STRAIN], method="nearest")
    states = [case.sel(applied_strain=strain) for case in cases for strain in strains.values]
    values = np.concatenate([state["strain_xx"].values.ravel() for state in states])
    colours = style.value_colours(values, signed=True)
    spans = [np.ptp(state["position"].values[..., :2], axis=(0, 1)) for state in states]
    widths, heights = 1.1 * np.transpose(spans)
    # No panel is narrower than its title.
    widths = np.maximum(widths, widths.sum() * MIN_WIDTH / TWO_COLUMNS)
    height = min(0.75 * TWO_COLUMNS * heights.max() / widths.sum() + 1.3, MAX_HEIGHT)
    look: Look = {"squeeze": False, "sharey": True, "width_ratios": widths}
    figure, (grid,) = style.subplots(height, 1, len(states), **look)
    for axes, state in zip(grid, states, strict=True):
        nodes = state["position"].values
        faces = sheets.grid_faces(nodes - [0, nodes[..., 1].min(), 0])
        case = recorded_case(state)
        local = on_grid_cells(case, state["strain_xx"].values).ravel()
        sheets.draw_faces(axes, faces, sheets.shaded(faces, colours.to_rgba(local)))
        patterned = "pattern" in state.coords
        design = str(state["pattern"].item()).replace("_", " ") if patterned else design_name(state)
        cells_y, cells_x = state["strain_xx"].shape
        shown = sheets.state_text(float(state["applied_strain"]))
        axes.set_title(f"{design}\n{cells_y} × {cells_x} cells\n{shown}", fontsize=7)
        axes.set(xlabel="", ylabel="")
        axes.xaxis.set_major_locator(MaxNLocator(2))
    unit = length_unit(cases[0])
    grid[0].set(xlabel=f"x, weft [{unit}]", ylabel=f"y, warp [{unit}]")
    label = "local transverse strain $\\varepsilon_{xx}$ [1]\nof a unit cell; shading is slope"
    style.colour_bar(list(grid), colours, label=label, shrink=0.8, aspect=30)
    figure.supxlabel(pull_note(cases[0]), fontsize=7)
    style.fit_height(figure, grid)
    return figure
