"""Springs and folds of a unit cell, on the chart and on the fabric (paper, Fig. 1F).

python docs/examples/network.py draws network.png beside it, of the kept case (4, 16) of periodic
fabric. Hinges that rest flat are not drawn.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from knitlab.export.meshes.fabric import closed_nodes
from knitlab.figures.figure_files import save
from knitlab.figures.sheets import design_text, frame_sheet
from knitlab.figures.style import TWO_COLUMNS, print_style
from knitlab.model.computing import computing
from knitlab.model.layout import FabricLayout
from knitlab.model.network import Elements
from knitlab.solvers.case import case_of

CASES = Path(__file__).parents[2] / "results" / "reference" / "periodic" / "cases"
ROLES: dict[str, dict[str, Any]] = {
    "diagonal spring": {"color": "0.75", "lw": 0.4},
    "weft spring": {"color": "#0072B2", "lw": 0.7},
    "warp spring": {"color": "#009E73", "lw": 0.7},
    "mountain fold": {"color": "#D55E00", "lw": 1.8},
    "valley fold": {"color": "black", "lw": 1.8, "ls": (0, (2, 1))},
}
"""Line style of the elements, drawn in this order."""


def by_role(layout: FabricLayout) -> dict[str, np.ndarray]:
    """Grid indices (line, end, (y, x)) of the lines of every role, in a closed unit cell."""
    net, sense = layout.net, layout.fold_sense
    springs, hinges = ends(net.springs), ends(net.hinges)
    return {
        "diagonal spring": springs[~(net.weft | net.warp)],
        "weft spring": springs[net.weft],
        "warp spring": springs[net.warp],
        "mountain fold": hinges[sense > 0],
        "valley fold": hinges[sense < 0],
    }


def ends(elements: Elements) -> np.ndarray:
    """Grid indices of the first two nodes of elements; images lie beyond the periodic boundary."""
    shape = elements.shape
    first = np.stack(np.divmod(elements.nodes[:, :2], shape.nodes_x), axis=-1)
    beyond = elements.images[:, :2, ::-1].astype(int) * [shape.cells_y, shape.cells_x]
    return first + beyond


@computing()
def draw(case_file: xr.Dataset) -> Figure:
    """One unit cell of periodic fabric, as knitted and relaxed."""
    lines = by_role(case_of(json.loads(case_file.attrs["parameters"])).layout)
    relaxed = closed_nodes(case_file.isel(applied_strain=[0]))[0]
    rows, columns = np.mgrid[: relaxed.shape[0], : relaxed.shape[1]]
    chart = np.stack([columns, rows], axis=-1)
    figure = Figure(figsize=(TWO_COLUMNS, 3.6))
    flat = figure.add_axes((0.06, 0.2, 0.36, 0.72))
    scene = figure.add_axes((0.44, 0.1, 0.56, 0.86), projection="3d")
    for role, line in lines.items():
        at = line[..., 0], line[..., 1]
        flat.add_collection(LineCollection(list(chart[at]), **ROLES[role]))
        scene.add_collection3d(Line3DCollection(list(relaxed[at]), **ROLES[role]))
    flat.set(xlabel="x, weft [grid cells]", ylabel="y, warp [grid cells]", aspect="equal")
    flat.autoscale_view()
    flat.xaxis.set_major_locator(MultipleLocator(4))
    flat.yaxis.set_major_locator(MultipleLocator(4))
    flat.set_title(f"one unit cell as knitted, {design_text(case_file)}")
    # Drawn in the order of the roles, not by depth: springs must not hide a fold.
    scene.computed_zorder = False
    frame_sheet(scene, relaxed)
    scene.set_title("the same, relaxed", y=0.96)
    handles = [Line2D([], [], label=role, **look) for role, look in ROLES.items()]
    figure.legend(handles=handles[1:] + handles[:1], loc="lower center", ncols=5)
    return figure


if __name__ == "__main__":
    (file,) = CASES.glob("4-16-*.nc")
    with print_style():
        save(draw(xr.load_dataset(file, engine="netcdf4")), Path(__file__).with_suffix(".png"))
