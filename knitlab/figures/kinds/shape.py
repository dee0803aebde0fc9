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
from knitlab.figures.sheets import design_text, draw_faces, faces_of, state_text
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
    """
    # JAX is imported only when this figure is drawn.
    from knitlab.fabric.pattern import recorded_pattern

    parameters = json.loads(case.attrs["parameters"])
    periodic = is_periodic(case)
    repeats = PERIODIC_REPEATS if periodic else 1
    nodes = closed_nodes(case.isel(applied_strain=[0]), (repeats, repeats))[0]
    along_y, along_x = parameters["unit_cells"]
    repeat = len(parameters["pattern"]), len(parameters["pattern"][0])
    sample = recorded_pattern(parameters, (repeats * along_y, repeats * along_x))

    faces = faces_of(nodes)
    heights = faces[:, :, 2].mean(axis=1)
    norm = mpl.colors.Normalize(heights.min(), heights.max())
    extent = np.ptp(nodes[..., :2], axis=(0, 1))
    height = ONE_COLUMN * min(1.6, 0.8 * extent[1] / extent[0]) + 0.7
    figure = Figure(figsize=(ONE_COLUMN * 1.2, height), layout="constrained")
    axes = figure.add_subplot()
    draw_faces(axes, faces, mpl.colormaps[SEQUENCE_COLOURS](norm(heights)))
    borders = (*nodes[sample.row_borders], *nodes[:, sample.column_borders].swapaxes(0, 1))
    lines = LineCollection([line[:, :2] for line in borders], colors="white", lw=BORDER)
    axes.add_collection(lines)
    _name_patches(axes, nodes, sample, repeat)
    notes = ["white lines: patch borders", *([LETTERS] if max(repeat) > MOST_NAMES else [])]
    crossing = int(case["self_intersections"][0]) if "self_intersections" in case else 0
    if crossing:
        notes.insert(0, f"passes through itself: {crossing} pairs of cells")
    state = ("periodic, " if periodic else "") + state_text(float(case["applied_strain"][0]))
    axes.set_title("\n".join([design_text(case), state, "; ".join(notes)]), fontsize=7)
    colours = mpl.cm.ScalarMappable(norm, SEQUENCE_COLOURS)
    figure.colorbar(colours, ax=axes, label="height z [mm]", shrink=0.8)
    return figure


def _name_patches(
    axes: Axes, nodes: np.ndarray, sample: "PatchGrid", repeat: tuple[int, int]
) -> None:
    """Write the knit on the patches of the repeat of the pattern nearest the middle."""
    from knitlab.fabric.pattern import KNIT_OF_LETTER

    large = max(repeat) <= MOST_NAMES
    first_row, first_column = (
        size * ((whole // size - 1) // 2)
        for size, whole in zip(repeat, sample.knit.shape, strict=True)
    )
    rows, columns = (
        (borders[:-1] + borders[1:]) // 2 for borders in (sample.row_borders, sample.column_borders)
    )
    for y, x in np.ndindex(repeat):
        row, column = first_row + y, first_column + x
        letter = str(sample.knit[row, column])
        across, along = nodes[rows[row], columns[column], :2]
        axes.text(
            across,
            along,
            KNIT_OF_LETTER[letter] if large else letter,
            ha="center",
            va="center",
            fontsize=NAME_SIZE if large else LETTER_SIZE,
            color="white",
            path_effects=[withStroke(linewidth=2, foreground="black")],
        )


FIGURE = FigureKind(fabric_shape, needs="position", coordinates=("applied_strain",))
