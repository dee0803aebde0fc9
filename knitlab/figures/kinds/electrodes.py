"""Electrodes: where they run on the flat chart, and on the relaxed shape."""

import json
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from scipy.interpolate import interp1d

from knitlab.cube.case_file import configurations
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.perspective import FABRIC, draw_sheet, frame_sheet
from knitlab.figures.style import TWO_COLUMNS
from knitlab.io.errors import fault

if TYPE_CHECKING:
    from knitlab.simulation.case import Case

COLOURS = ("#D55E00", "#0072B2")
RIB, GARTER, PLAIN = "0.82", "0.94", "1.0"
SHADES = {"R": RIB, "G": GARTER, "P": PLAIN}
HEIGHT = 3.6
"""Height of the figure [in]."""
CELLS_PER_TICK = 4
FINE_PARTS, COARSE_PARTS, FEW_CELLS = 4, 2, 24
"""Subdivisions of a grid cell along each direction: fine up to this many cells, else coarse."""
MOST_TICKS = 12


def electrodes_figure(case_file: xr.Dataset) -> Figure:
    """Where the electrodes run, on the chart and on the fabric, relaxed or at ``applied_strain``.

    Args:
        case_file: contents of a case file, with node positions.

    Raises:
        BadInput: if the case has no electrodes.
    """
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.pattern import KNIT_OF_LETTER
    from knitlab.simulation.case import case_of

    parameters = json.loads(case_file.attrs["parameters"])
    if not parameters.get("capacitor"):
        raise fault("electrodes", "this case has no electrodes; run a workflow with [electrodes]")
    case = case_of(parameters)
    figure = Figure(figsize=(TWO_COLUMNS, HEIGHT))
    chart = figure.add_axes((0.06, 0.2, 0.36, 0.7))
    scene = figure.add_axes((0.44, 0.1, 0.56, 0.86), projection="3d")
    _draw_chart(chart, case)
    _draw_relaxed(scene, case, case_file)
    design = ", ".join(f"{name} = {value}" for name, value in case.design.items())
    chart.set_title(f"as knitted, {design}")
    patches = [
        Patch(color=colour, label=f"electrode {k}") for k, colour in zip("AB", COLOURS, strict=True)
    ]
    knits = [(KNIT_OF_LETTER[letter], SHADES[letter]) for letter in np.unique(case.sample.knit)]
    if case.pure:
        knits = [(case.weft.knit, GARTER)]
    patches += [
        Patch(facecolor=shade, edgecolor="0.6", lw=0.5, label=knit) for knit, shade in knits
    ]
    figure.legend(handles=patches, loc="lower center", ncols=4, frameon=False)
    return figure


def _draw_chart(axes: Axes, case: "Case") -> None:
    sample = case.sample
    rows, columns = sample.row_borders, sample.column_borders
    for row, column in np.ndindex(sample.knit.shape):
        width, height = columns[column + 1] - columns[column], rows[row + 1] - rows[row]
        shade = SHADES[str(sample.knit[row, column])]
        corner = float(columns[column]), float(rows[row])
        axes.add_patch(Rectangle(corner, float(width), float(height), color=shade, lw=0))
    for strips, colour in zip(case.electrodes.strips, COLOURS, strict=True):
        polygons = [
            [
                (strip.left, strip.bottom),
                (strip.right, strip.bottom),
                (strip.right, strip.top),
                (strip.left, strip.top),
            ]
            for strip in strips
        ]
        axes.add_collection(PolyCollection(polygons, facecolor=colour, edgecolor="none"))
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


def _draw_relaxed(scene: Axes3D, case: "Case", case_file: xr.Dataset) -> None:
    from knitlab.measure.unit_cells import nodes_at

    shape = case.mesh_shape
    rows, columns = np.arange(shape.cells_y + 1), np.arange(shape.cells_x + 1)
    sheet = np.asarray(nodes_at(shape, configurations(case_file)[0], rows, columns))
    parts = FINE_PARTS if max(shape.cells_y, shape.cells_x) <= FEW_CELLS else COARSE_PARTS
    x, y = ((np.arange(cells * parts) + 0.5) / parts for cells in (shape.cells_x, shape.cells_y))
    shades = np.full((len(y), len(x)), FABRIC, dtype=object)
    for strips, colour in zip(case.electrodes.strips, COLOURS, strict=True):
        for strip in strips:
            shades[np.ix_(_inside(y, *strip.extents[1]), _inside(x, *strip.extents[0]))] = colour
            beyond = x + shape.cells_x if shape.periodic else x
            shades[np.ix_(_inside(y, *strip.extents[1]), _inside(beyond, *strip.extents[0]))] = (
                colour
            )
    draw_sheet(scene, _refined(_refined(sheet, parts, 0), parts, 1), shades.ravel().tolist())
    frame_sheet(scene, sheet)
    strain = float(case_file["applied_strain"][0])
    scene.set_title(f"pulled {strain:.0%}" if strain else "relaxed", y=0.96)


def _inside(x: np.ndarray, low: float, high: float) -> np.ndarray:
    return (x > low) & (x < high)


def _refined(nodes: np.ndarray, parts: int, axis: int) -> np.ndarray:
    """Nodes of a sheet, refined along an axis by linear interpolation."""
    fine = np.arange((nodes.shape[axis] - 1) * parts + 1) / parts
    return interp1d(np.arange(nodes.shape[axis]), nodes, axis=axis)(fine)


FIGURE = FigureKind(electrodes_figure, dims=None, needs="position", coordinates=("applied_strain",))
