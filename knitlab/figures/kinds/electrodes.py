"""Where electrodes run, on the chart and on the fabric."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from mpl_toolkits.mplot3d import Axes3D
from scipy.interpolate import RegularGridInterpolator

from knitlab.cubes.case_file import length_unit
from knitlab.export.meshes.fabric import closed_nodes
from knitlab.figures import sheets
from knitlab.figures.registry import figure
from knitlab.figures.style import TWO_COLUMNS
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

if TYPE_CHECKING:
    from knitlab.solvers.case import Case

COLOURS = {"A": "#D55E00", "B": "#0072B2"}  # of the electrodes
SHADES = {"R": "0.75", "G": "0.92", "P": "1.0"}  # grey of every knit, by its letter
MAX_TICKS = 8  # along a side
FINE, COARSE, FEW_CELLS = 4, 2, 24  # subdivisions of a grid cell: fine up to so many cells


@figure(dims=None, needs="position", coordinates=(STRAIN,))
def electrodes(case_file: xr.Dataset) -> Figure:
    """Where electrodes run, on the chart and on the fabric, relaxed or at ``applied_strain``."""
    from knitlab.cubes.recorded_case import recorded_case
    from knitlab.model.pattern import KNIT_OF_LETTER

    case = recorded_case(case_file)
    if case.capacitor is None:
        raise invalid("electrodes", "this case has no electrodes; run a workflow with [electrodes]")
    figure = Figure(figsize=(TWO_COLUMNS, 3.6))
    chart = figure.add_axes((0.06, 0.2, 0.36, 0.7))
    _draw_chart(chart, case)
    chart.set_title(", ".join(["flat", *(f"{name} = {n}" for name, n in case.design.items())]))
    scene = figure.add_axes((0.44, 0.1, 0.56, 0.86), projection="3d")
    _draw_fabric(scene, case, case_file)
    scene.set_title(sheets.state_text(float(case_file["applied_strain"][0])), y=0.96)
    handles = [Patch(color=colour, label=f"electrode {name}") for name, colour in COLOURS.items()]
    knits = {KNIT_OF_LETTER[letter]: SHADES[letter] for letter in np.unique(case.sample.knit)}
    if case.pure:
        knits = {case.weft.knit: SHADES["G"]}
    handles += [Patch(fc=shade, ec="0.6", lw=0.5, label=knit) for knit, shade in knits.items()]
    figure.legend(handles=handles, loc="lower center", ncols=4)
    return figure


def _draw_chart(axes: Axes, case: "Case") -> None:
    from knitlab.export.knitting.stitch_chart import stitch_chart

    sample = case.sample
    rows, columns = sample.row_borders.tolist(), sample.column_borders.tolist()
    for row, column in np.ndindex(sample.knit.shape):
        corner = columns[column], rows[row]
        size = columns[column + 1] - columns[column], rows[row + 1] - rows[row]
        axes.add_patch(Rectangle(corner, *size, color=SHADES[str(sample.knit[row, column])], lw=0))
    for strips, colour in zip(case.electrodes.strips, COLOURS.values(), strict=True):
        for strip in strips:
            size = strip.right - strip.left, strip.top - strip.bottom
            axes.add_patch(Rectangle((strip.left, strip.bottom), *size, color=colour, lw=0))
    height, width = sample.grid
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    axes.set(xlabel="x, weft [wales]", ylabel="y, warp [courses]")
    chart = stitch_chart(case)
    for axis, lines, stitches in (
        (axes.xaxis, columns, chart.column_borders),
        (axes.yaxis, rows, chart.row_borders),
    ):
        some = slice(None, None, 1 + (len(lines) - 1) // MAX_TICKS)
        axis.set_ticks(lines[some], [str(number) for number in stitches[some]])


def _draw_fabric(scene: Axes3D, case: "Case", case_file: xr.Dataset) -> None:
    sheet = closed_nodes(case_file.isel(applied_strain=[0]))[0]
    cells = sheet.shape[0] - 1, sheet.shape[1] - 1
    subdivisions = FINE if max(cells) <= FEW_CELLS else COARSE
    y, x = ((np.arange(count * subdivisions) + 0.5) / subdivisions for count in cells)
    colours = np.full((len(y), len(x)), sheets.FABRIC, dtype=object)
    for strips, colour in zip(case.electrodes.strips, COLOURS.values(), strict=True):
        for strip in strips:
            (left, right), (low, high) = strip.extents
            across = (left < x) & (x < right)
            if case.mesh_shape.periodic:
                across |= (left < x + cells[1]) & (x + cells[1] < right)
            colours[np.ix_((low < y) & (y < high), across)] = colour
    along = (np.arange(n * subdivisions + 1) / subdivisions for n in cells)
    fine = np.meshgrid(*along, indexing="ij")
    refined = RegularGridInterpolator([np.arange(n + 1) for n in cells], sheet)
    sheets.draw_sheet(scene, refined(np.stack(fine, axis=-1)), colours.ravel().tolist())
    sheets.frame_sheet(scene, sheet)
    sheets.draw_scale(scene, sheet, length_unit(case_file))
