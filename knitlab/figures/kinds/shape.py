"""The shape of one design, as a shaded relief seen from the technical face."""

import json

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.relief import draw_relief, faces_of
from knitlab.figures.style import ONE_COLUMN, SEQUENCE_COLOURS

PERIODIC_REPEATS = 2
"""Unit cells of periodic fabric that are drawn along each direction."""


def fabric_shape(case: xr.Dataset) -> Figure:
    """Relief of a fabric seen from the technical face; relaxed, or at ``applied_strain``.

    Colour is height, shading is slope, lines are patch borders.

    Args:
        case: contents of a case file, with node positions; its first strain is shown.
    """
    parameters = json.loads(case.attrs["parameters"])
    nodes = whole_sheet(case)
    periodic = parameters["reading"]["boundary"] == "periodic"
    cells_y = case.sizes["node_y"] - (not periodic)
    spans = cells_y // (parameters["unit_cells"][0] * len(parameters["pattern"]))

    faces = faces_of(nodes)
    heights = faces[:, :, 2].mean(axis=1)
    norm = mpl.colors.Normalize(heights.min(), heights.max())
    colours = mpl.colormaps[SEQUENCE_COLOURS](norm(heights))
    borders = np.concatenate(
        [_segments(line) for line in (*nodes[::spans], *nodes.swapaxes(0, 1)[::spans])]
    )
    extent = np.ptp(nodes[..., :2], axis=(0, 1))
    height = ONE_COLUMN * min(1.6, 0.8 * extent[1] / extent[0]) + 0.7
    figure = Figure(figsize=(ONE_COLUMN * 1.2, height), layout="constrained")
    axes = figure.add_subplot()
    draw_relief(axes, faces, colours, borders)
    _name_patches(axes, nodes, parameters["pattern"], spans)
    design = f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"
    strain = float(case["applied_strain"][0])
    notes = [design, *(["periodic"] if periodic else []), *([f"at {strain:.0%}"] if strain else [])]
    axes.set_title(", ".join(notes))
    figure.colorbar(
        mpl.cm.ScalarMappable(norm, SEQUENCE_COLOURS), ax=axes, label="height z [mm]", shrink=0.8
    )
    return figure


def _segments(line: np.ndarray) -> np.ndarray:
    """Segments (segment, end, component) of a line of nodes."""
    return np.stack([line[:-1], line[1:]], axis=1)


def whole_sheet(case: xr.Dataset) -> np.ndarray:
    """Nodes (y, x, component) at the first strain; periodic fabric is repeated and closed."""
    nodes = case["position"].isel(applied_strain=0).values
    if "length_x" not in case:
        return nodes
    across = np.array([float(case["length_x"][0]), 0, 0])
    along = np.array([0, float(case["length_y"][0]), 0])
    row = np.concatenate([nodes + k * across for k in range(PERIODIC_REPEATS)], axis=1)
    row = np.concatenate([row, row[:, :1] + PERIODIC_REPEATS * across], axis=1)
    sheet = np.concatenate([row + k * along for k in range(PERIODIC_REPEATS)], axis=0)
    return np.concatenate([sheet, sheet[:1] + PERIODIC_REPEATS * along], axis=0)


def _name_patches(axes: Axes, nodes: np.ndarray, pattern: list[str], spans: int) -> None:
    """Write ``rib`` or ``garter`` on the patches of a unit cell near the middle."""
    rows, columns = len(pattern), len(pattern[0])
    first_y = rows * ((nodes.shape[0] // (rows * spans) - 1) // 2)
    first_x = columns * ((nodes.shape[1] // (columns * spans) - 1) // 2)
    for patch_y, letters in enumerate(reversed(pattern)):
        for patch_x, letter in enumerate(letters):
            middle_y = int((first_y + patch_y + 0.5) * spans)
            middle_x = int((first_x + patch_x + 0.5) * spans)
            x, y, _ = nodes[middle_y, middle_x]
            axes.text(
                x,
                y,
                "rib" if letter in "Rr" else "garter",
                ha="center",
                va="center",
                color="white",
                path_effects=[withStroke(linewidth=2, foreground="black")],
            )


FIGURE = FigureKind(fabric_shape, needs="position", coordinates=("applied_strain",))
