"""The spring network of a unit cell, coloured by role (paper, Fig. 1F)."""

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from knitlab.cube.case_file import configurations
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.perspective import frame_sheet
from knitlab.figures.style import TWO_COLUMNS

if TYPE_CHECKING:
    from knitlab.fabric.layout import FabricLayout
    from knitlab.fabric.network import Elements

ROLES: dict[str, dict[str, Any]] = {
    "diagonal spring": {"color": "0.75", "lw": 0.4},
    "weft spring": {"color": "#0072B2", "lw": 0.7},
    "warp spring": {"color": "#009E73", "lw": 0.7},
    "mountain fold": {"color": "#D55E00", "lw": 1.8},
    "valley fold": {"color": "black", "lw": 1.8, "ls": (0, (2, 1))},
}
"""Line style of the elements, drawn in this order."""
CELLS_PER_TICK = 4
"""Grid cells in a period of the folds."""
HEIGHT = 3.6
"""Height of the figure [in]."""


def spring_network(case: xr.Dataset) -> Figure:
    """Springs and folds of a unit cell, on the chart and on the fabric (paper, Fig. 1F).

    Hinges that rest flat are not drawn.

    Args:
        case: contents of a case file, with node positions.
    """
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.layout import fabric_layout
    from knitlab.fabric.network import MeshShape
    from knitlab.fabric.pattern import recorded_pattern
    from knitlab.fabric.settings import ModelOptions, PlainKnit, Sheet
    from knitlab.measure.cell_grid import CellGrid
    from knitlab.measure.patches import central_cell

    parameters = json.loads(case.attrs["parameters"])
    options = ModelOptions(**parameters["reading"] | {"boundary": "periodic"})
    pattern = recorded_pattern(parameters, (1, 1))
    plain = PlainKnit(**parameters["plain"]) if parameters.get("plain") else None
    lines = _by_role(fabric_layout(pattern, Sheet(**parameters["sheet"]), options, plain))

    periodic = "length_x" in case
    cells_y, cells_x = (case.sizes[dim] - (not periodic) for dim in ("node_y", "node_x"))
    shape = MeshShape(cells_y, cells_x, periodic)
    repeats = CellGrid.even(shape, tuple(parameters["unit_cells"]))
    cell = central_cell(shape, repeats, configurations(case)[0])

    figure = Figure(figsize=(TWO_COLUMNS, HEIGHT))
    flat = figure.add_axes((0.06, 0.2, 0.36, 0.72))
    scene = figure.add_axes((0.44, 0.1, 0.56, 0.86), projection="3d")
    rows, columns = np.mgrid[: cell.shape[0], : cell.shape[1]]
    _draw_flat(flat, np.stack([columns, rows], axis=-1), lines)
    _draw_relaxed(scene, cell, lines)
    design = f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"
    strain = float(case["applied_strain"][0])
    flat.set_title(f"one unit cell as knitted, {design}")
    scene.set_title(f"the same, pulled {strain:.0%}" if strain else "the same, relaxed", y=0.96)
    handles = [Line2D([], [], label=role, **look) for role, look in ROLES.items()]
    figure.legend(handles=handles[1:] + handles[:1], loc="lower center", ncols=5, frameon=False)
    return figure


def _by_role(layout: "FabricLayout") -> dict[str, np.ndarray]:
    """Grid indices (line, end, (y, x)) of the lines of every role, in a closed unit cell."""
    springs, hinges = _ends(layout.net.springs), _ends(layout.net.hinges)
    sense, net = layout.fold_sense, layout.net
    return {
        "diagonal spring": springs[~(net.weft | net.warp)],
        "weft spring": springs[net.weft],
        "warp spring": springs[net.warp],
        "mountain fold": hinges[sense > 0],
        "valley fold": hinges[sense < 0],
    }


def _ends(elements: "Elements") -> np.ndarray:
    """Grid indices of the first two nodes of elements; images lie beyond the periodic boundary."""
    shape = elements.shape
    places = np.stack(np.divmod(elements.nodes[:, :2], shape.nodes_x), axis=-1)
    return places + elements.images[:, :2, ::-1] * [shape.cells_y, shape.cells_x]


def _draw_flat(axes: Axes, chart: np.ndarray, lines: dict[str, np.ndarray]) -> None:
    for role, ends in lines.items():
        axes.add_collection(LineCollection(list(_at(chart, ends)), **ROLES[role]))
    axes.set(xlabel="x, weft [grid cells]", ylabel="y, warp [grid cells]", aspect="equal")
    axes.autoscale_view()
    axes.xaxis.set_major_locator(MultipleLocator(CELLS_PER_TICK))
    axes.yaxis.set_major_locator(MultipleLocator(CELLS_PER_TICK))


def _draw_relaxed(scene: Axes3D, cell: np.ndarray, lines: dict[str, np.ndarray]) -> None:
    for role, ends in lines.items():
        scene.add_collection3d(Line3DCollection(list(_at(cell, ends)), **ROLES[role]))
    # Drawn in the order of the roles, not by depth: springs must not hide a fold.
    scene.computed_zorder = False
    frame_sheet(scene, cell)


def _at(nodes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    return nodes[ends[..., 0], ends[..., 1]]


FIGURE = FigureKind(spring_network, needs="position", coordinates=("applied_strain",))
