"""Electrodes: where they run on the flat chart, and on the relaxed shape."""

import json
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from scipy.interpolate import RegularGridInterpolator

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.sheets import FABRIC, draw_sheet, frame_sheet, state_text
from knitlab.figures.style import TWO_COLUMNS
from knitlab.io.errors import fault
from knitlab.meshes.fabric import closed_nodes

if TYPE_CHECKING:
    from knitlab.simulation.case import Case

COLOURS = ("#D55E00", "#0072B2")
SHADES = {"R": "0.82", "G": "0.94", "P": "1.0"}
"""Grey of every knit, by its letter."""
CELLS_PER_TICK, MOST_TICKS = 4, 12
FINE_PARTS, COARSE_PARTS, FEW_CELLS = 4, 2, 24
"""Subdivisions of a grid cell along each direction: fine up to this many cells, else coarse."""


def electrodes_figure(case_file: xr.Dataset) -> Figure:
    """Where electrodes run, on the chart and on the fabric, relaxed or at ``applied_strain``."""
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.pattern import KNIT_OF_LETTER
    from knitlab.simulation.case import case_of

    parameters = json.loads(case_file.attrs["parameters"])
    if not parameters.get("capacitor"):
        raise fault("electrodes", "this case has no electrodes; run a workflow with [electrodes]")
    case = case_of(parameters)
    figure = Figure(figsize=(TWO_COLUMNS, 3.6))
    chart = figure.add_axes((0.06, 0.2, 0.36, 0.7))
    _draw_chart(chart, case)
    design = ", ".join(f"{name} = {value}" for name, value in case.design.items())
    chart.set_title(f"as knitted, {design}")
    scene = figure.add_axes((0.44, 0.1, 0.56, 0.86), projection="3d")
    _draw_fabric(scene, case, case_file)
    scene.set_title(state_text(float(case_file["applied_strain"][0])), y=0.96)
    handles = [
        Patch(color=colour, label=f"electrode {letter}")
        for letter, colour in zip("AB", COLOURS, strict=True)
    ]
    knits = {KNIT_OF_LETTER[letter]: SHADES[letter] for letter in np.unique(case.sample.knit)}
    if case.pure:
        knits = {case.weft.knit: SHADES["G"]}
    handles += [Patch(fc=shade, ec="0.6", lw=0.5, label=knit) for knit, shade in knits.items()]
    figure.legend(handles=handles, loc="lower center", ncols=4)
    return figure


def _draw_chart(axes: Axes, case: "Case") -> None:
    sample = case.sample
    rows, columns = sample.row_borders.tolist(), sample.column_borders.tolist()
    for row, column in np.ndindex(sample.knit.shape):
        corner = columns[column], rows[row]
        size = columns[column + 1] - columns[column], rows[row + 1] - rows[row]
        shade = SHADES[str(sample.knit[row, column])]
        axes.add_patch(Rectangle(corner, *size, color=shade, lw=0))
    for strips, colour in zip(case.electrodes.strips, COLOURS, strict=True):
        for strip in strips:
            size = strip.right - strip.left, strip.top - strip.bottom
            axes.add_patch(Rectangle((strip.left, strip.bottom), *size, color=colour, lw=0))
    height, width = sample.grid
    axes.set(
        xlim=(0, width),
        ylim=(0, height),
        xlabel="x, weft [grid cells]",
        ylabel="y, warp [grid cells]",
        aspect="equal",
    )
    step = CELLS_PER_TICK * int(np.ceil(max(width, height) / CELLS_PER_TICK / MOST_TICKS))
    axes.xaxis.set_major_locator(MultipleLocator(step))
    axes.yaxis.set_major_locator(MultipleLocator(step))


def _draw_fabric(scene: Axes3D, case: "Case", case_file: xr.Dataset) -> None:
    sheet = closed_nodes(case_file.isel(applied_strain=[0]))[0]
    cells = sheet.shape[0] - 1, sheet.shape[1] - 1
    parts = FINE_PARTS if max(cells) <= FEW_CELLS else COARSE_PARTS
    y, x = ((np.arange(count * parts) + 0.5) / parts for count in cells)
    colours = np.full((len(y), len(x)), FABRIC, dtype=object)
    for strips, colour in zip(case.electrodes.strips, COLOURS, strict=True):
        for strip in strips:
            (left, right), (low, high) = strip.extents
            across = (left < x) & (x < right)
            if case.mesh_shape.periodic:
                across |= (left < x + cells[1]) & (x + cells[1] < right)
            colours[np.ix_((low < y) & (y < high), across)] = colour
    fine = np.meshgrid(*(np.arange(n * parts + 1) / parts for n in cells), indexing="ij")
    refined = RegularGridInterpolator([np.arange(n + 1) for n in cells], sheet)
    draw_sheet(scene, refined(np.stack(fine, axis=-1)), colours.ravel().tolist())
    frame_sheet(scene, sheet)


FIGURE = FigureKind(electrodes_figure, dims=None, needs="position", coordinates=("applied_strain",))
