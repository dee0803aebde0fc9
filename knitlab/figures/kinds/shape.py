"""The shape of one design, seen from the technical face and coloured by height."""

import json
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.plan_view import draw_faces, faces_of
from knitlab.figures.style import ONE_COLUMN, SEQUENCE_COLOURS
from knitlab.meshes.fabric import closed_nodes, is_periodic

if TYPE_CHECKING:
    from knitlab.fabric.pattern import PatchGrid

BORDER = 0.6
"""Width of the lines of patch borders [pt]."""
NAME_SIZE, LETTER_SIZE = 8, 6
MOST_NAMES = 4
"""Patches along a side that are named; where there are more they have a letter each."""
LETTERS = "R rib, G garter, P plain"
PERIODIC_REPEATS = 2
"""Unit cells of periodic fabric that are drawn along each direction."""


def fabric_shape(case: xr.Dataset) -> Figure:
    """Shape of a fabric seen from the technical face; relaxed, or at ``applied_strain``.

    Colour is height, white lines are patch borders.

    Args:
        case: contents of a case file, with node positions; its first strain is shown.
    """
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.pattern import recorded_pattern

    parameters = json.loads(case.attrs["parameters"])
    nodes = whole_sheet(case)
    periodic = parameters["reading"]["boundary"] == "periodic"
    along_y, along_x = parameters["unit_cells"]
    repeats = PERIODIC_REPEATS if periodic else 1
    repeat = len(parameters["pattern"]), len(parameters["pattern"][0])
    sample = recorded_pattern(parameters, (repeats * along_y, repeats * along_x))

    faces = faces_of(nodes)
    heights = faces[:, :, 2].mean(axis=1)
    norm = mpl.colors.Normalize(heights.min(), heights.max())
    colours = mpl.colormaps[SEQUENCE_COLOURS](norm(heights))
    extent = np.ptp(nodes[..., :2], axis=(0, 1))
    height = ONE_COLUMN * min(1.6, 0.8 * extent[1] / extent[0]) + 0.7
    figure = Figure(figsize=(ONE_COLUMN * 1.2, height), layout="constrained")
    axes = figure.add_subplot()
    draw_faces(axes, faces, colours)
    borders = (*nodes[sample.row_borders], *nodes[:, sample.column_borders].swapaxes(0, 1))
    axes.add_collection(
        LineCollection([line[:, :2] for line in borders], colors="white", lw=BORDER)
    )
    _name_patches(axes, nodes, sample, repeat)
    design = f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"
    strain = float(case["applied_strain"][0])
    state = f"pulled {strain:.0%}" if strain else "relaxed"
    notes = ["white lines: patch borders", *([LETTERS] if max(repeat) > MOST_NAMES else [])]
    crossing = int(case["self_intersections"][0]) if "self_intersections" in case else 0
    if crossing:
        notes.insert(0, f"passes through itself: {crossing} pairs of cells")
    title = [design, f"{'periodic, ' if periodic else ''}{state}", "; ".join(notes)]
    axes.set_title("\n".join(title), fontsize=7)
    figure.colorbar(
        mpl.cm.ScalarMappable(norm, SEQUENCE_COLOURS), ax=axes, label="height z [mm]", shrink=0.8
    )
    return figure


def whole_sheet(case: xr.Dataset) -> np.ndarray:
    """Nodes (y, x, component) at the first strain; periodic fabric is repeated and closed."""
    repeats = PERIODIC_REPEATS if is_periodic(case) else 1
    return closed_nodes(case.isel(applied_strain=[0]), (repeats, repeats))[0]


def _name_patches(
    axes: Axes, nodes: np.ndarray, sample: "PatchGrid", repeat: tuple[int, int]
) -> None:
    """Write the knit on the patches of the repeat of the pattern nearest the middle."""
    from knitlab.fabric.pattern import KNIT_OF_LETTER

    first = [
        size * ((whole // size - 1) // 2)
        for size, whole in zip(repeat, sample.knit.shape, strict=True)
    ]
    rows, columns = sample.row_borders, sample.column_borders
    large = max(repeat) <= MOST_NAMES
    for patch_y, patch_x in np.ndindex(repeat):
        row, column = first[0] + patch_y, first[1] + patch_x
        letter = str(sample.knit[row, column])
        x, y, _ = nodes[
            (rows[row] + rows[row + 1]) // 2, (columns[column] + columns[column + 1]) // 2
        ]
        axes.text(
            x,
            y,
            KNIT_OF_LETTER[letter] if large else letter,
            ha="center",
            va="center",
            fontsize=NAME_SIZE if large else LETTER_SIZE,
            color="white",
            path_effects=[withStroke(linewidth=2, foreground="black")],
        )


FIGURE = FigureKind(fabric_shape, needs="position", coordinates=("applied_strain",))
