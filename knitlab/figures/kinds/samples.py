"""Samples between clamps (paper, Fig. "tension images"): local strain, and how they look."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.cube.case_file import length_unit
from knitlab.cube.cube_file import is_measured, source_of
from knitlab.cube.schema import DESIGN_DIMS, Status
from knitlab.figures.cells import design_name, designs_of
from knitlab.figures.kinds import FigureKind
from knitlab.figures.sheets import draw_faces, faces_of, shaded, state_text
from knitlab.figures.style import TWO_COLUMNS, Look, colour_bar, value_colours
from knitlab.io.errors import fault
from knitlab.meshes.fabric import on_grid_cells

SHOWN_STRAIN = 0.23
PAPER_DESIGNS = ((8, 48), (4, 16), (4, 32))
CENTRAL: Look = {"fill": False, "ec": "0.2", "lw": 1.2}
COMPONENTS = {
    "strain_xx": "transverse strain $\\varepsilon_{xx}$",
    "strain_yy": "axial strain $\\varepsilon_{yy}$",
}


def tension_maps(cubes: Sequence[xr.Dataset]) -> Figure:
    """Local strain over samples between clamps (paper, Fig. "tension images").

    Lengths are those of the relaxed cloth, by the gauge. Shows the paper's three samples, and
    measured samples of any design, at ``applied_strain`` or the recorded strain nearest 0.23. Cells
    that lost a marker are white.
    """
    shown = _samples(cubes)
    if not shown:
        names = ", ".join(map(str, PAPER_DESIGNS))
        raise fault("tension", f"no cube has one of {names} with more than one unit cell")
    figure = Figure(figsize=(TWO_COLUMNS, 5.2), layout="constrained")
    grid = figure.subplots(len(COMPONENTS), len(shown), squeeze=False)
    for row, (name, label) in zip(grid, COMPONENTS.items(), strict=True):
        values = np.concatenate([sample[name].values.ravel() for sample in shown])
        colours = value_colours(values, signed=True)
        for axes, sample in zip(row, shown, strict=True):
            _draw_cells(axes, sample, name, colours)
            title = design_name(sample)
            title += f" {source_of(sample)}" if is_measured(sample) else ""
            axes.set(xlabel="x, weft [mm]", ylabel="y, warp [mm]", aspect="equal", title=title)
        colour_bar(list(row), colours, label=f"{label} [1]", shrink=0.9)
    strains = dict.fromkeys(f"{float(sample['applied_strain']):.0%}" for sample in shown)
    figure.suptitle(f"applied strain {' and '.join(strains)}", fontsize="medium")
    averaged = Patch(**CENTRAL, label="unit cells over which strains are averaged")
    figure.legend(handles=[averaged], loc="outside lower center")
    return figure


def _samples(cubes: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """The samples at the shown strain: the paper's three, then measured ones."""
    samples = [
        design.sel(applied_strain=SHOWN_STRAIN, method="nearest")
        for cube in cubes
        if "strain_xx" in cube
        for design in designs_of(cube)
        if int(design["status"]) == Status.ok
    ]
    samples = [sample for sample in samples if int(sample["strain_xx"].notnull().sum()) > 1]
    order = {str(design): number for number, design in enumerate(PAPER_DESIGNS)}
    shown = [each for each in samples if is_measured(each) or design_name(each) in order]
    return sorted(shown, key=lambda each: order.get(design_name(each), len(order)))


def _draw_cells(axes: Axes, sample: xr.Dataset, name: str, colours: ScalarMappable) -> None:
    from knitlab.measure.unit_cells import central

    observed = sample[name].dropna("cell_y", how="all").dropna("cell_x", how="all")
    rows, columns = observed.shape
    # Relaxed sizes of an experiment are those of the cloth.
    kind = "knit" if "knit_cell_x" in sample else "relaxed"
    width, height = (float(sample[f"{kind}_cell_{direction}"]) for direction in "xy")
    x, y = width * np.arange(columns + 1), height * np.arange(rows + 1)
    look: Look = {"cmap": colours.cmap, "norm": colours.norm, "edgecolors": "0.8", "lw": 0.3}
    axes.pcolormesh(x, y, observed.values, **look)
    inner_y, inner_x = central(rows), central(columns)
    corner = x[inner_x.start], y[inner_y.start]
    size = x[inner_x.stop] - x[inner_x.start], y[inner_y.stop] - y[inner_y.start]
    axes.add_patch(Rectangle(corner, *size, **CENTRAL))


def stretched_samples(cases: Sequence[xr.Dataset]) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Each is shown relaxed and at the recorded strain nearest 0.23, or at one or two selected values
    of ``applied_strain``.
    """
    from knitlab.simulation.case import case_of

    if any("length_x" in case for case in cases):
        raise fault("samples", "shows samples between clamps, not periodic fabric; draw shape")
    strains = cases[0]["applied_strain"]
    if len(strains) > 2:
        strains = strains.sel(applied_strain=[0, SHOWN_STRAIN], method="nearest")
    states = [case.sel(applied_strain=strain) for case in cases for strain in strains.values]
    values = np.concatenate([state["strain_xx"].values.ravel() for state in states])
    by_strain = value_colours(values, signed=True)
    spans = [np.ptp(state["position"].values[..., :2], axis=(0, 1)) for state in states]
    widths, heights = 1.1 * np.transpose(spans)
    height = 0.75 * TWO_COLUMNS * heights.max() / widths.sum() + 1.3
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    grid = figure.subplots(1, len(states), squeeze=False, sharey=True, width_ratios=widths)[0]
    for axes, state in zip(grid, states, strict=True):
        nodes = state["position"].values
        faces = faces_of(nodes - [0, nodes[..., 1].min(), 0])
        case = case_of(json.loads(state.attrs["parameters"]))
        local = on_grid_cells(case, state["strain_xx"].values).ravel()
        draw_faces(axes, faces, shaded(faces, by_strain.to_rgba(local)))
        patterned = "pattern" in state.coords
        design = str(state["pattern"].item()).replace("_", " ") if patterned else design_name(state)
        cells_y, cells_x = state["strain_xx"].shape
        shown = state_text(float(state["applied_strain"]))
        axes.set(title=f"{design}\n{cells_x} × {cells_y} cells\n{shown}", xlabel="", ylabel="")
    grid[0].set_ylabel(f"y, warp [{length_unit(cases[0])}]")
    figure.supxlabel(f"x, weft [{length_unit(cases[0])}]", fontsize="medium")
    label = "local transverse strain $\\varepsilon_{xx}$ [1]\nof a unit cell; shading is slope"
    colour_bar(list(grid), by_strain, label=label, shrink=0.8, aspect=30)
    return figure


SLICED = ("applied_strain",)
FIGURES = {
    "tension": FigureKind(tension_maps, several="experiments", coordinates=SLICED),
    "samples": FigureKind(stretched_samples, DESIGN_DIMS, "position", PAPER_DESIGNS, SLICED),
}
