"""The shape of a fabric from above, coloured by its height."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from knitlab.cubes.case_file import length_unit
from knitlab.export.meshes.fabric import closed_nodes, is_periodic
from knitlab.figures import sheets, style
from knitlab.figures.registry import figure
from knitlab.figures.style import ONE_COLUMN, SEQUENCE_COLOURS, Look
from knitlab.observables.schema import STRAIN

if TYPE_CHECKING:
    from knitlab.model.pattern import PatchGrid

MAX_NAMES = (
    6  # patches along a course whose names have room; where there are more they have letters
)
LETTERS = "R rib, G garter, P plain"


@figure(needs="position", coordinates=(STRAIN,))
def shape(case: xr.Dataset) -> Figure:
    """Shape of a fabric seen from the technical face; relaxed, or at ``applied_strain``.

    Colour is height, white lines are patch borders.
    """
    from knitlab.cubes.recorded_case import recorded_case

    recorded = recorded_case(case)
    repeats = 2 if is_periodic(case) else 1
    nodes = closed_nodes(case.isel(applied_strain=[0]), (repeats, repeats))[0]
    along_y, along_x = recorded.unit_cells
    repeat = len(recorded.pattern), len(recorded.pattern[0])
    cells = repeats * along_y, repeats * along_x
    sample = replace(recorded, unit_cells=cells).sample
    faces = sheets.grid_faces(nodes)
    if recorded.spans is not None:
        faces = faces[recorded.mesh_shape.has_fabric.ravel()]
    heights = faces[:, :, 2].mean(axis=1)
    colours = ScalarMappable(Normalize(heights.min(), heights.max()), SEQUENCE_COLOURS)
    extent = np.ptp(faces[..., :2], axis=(0, 1))
    height = ONE_COLUMN * min(1.6, 0.8 * extent[1] / extent[0]) + 0.7
    figure, axes = style.subplots(height, width=ONE_COLUMN * 1.2)
    unit = length_unit(case)
    sheets.draw_faces(axes, faces, colours.to_rgba(heights), unit)
    borders = (*nodes[sample.row_borders], *nodes[:, sample.column_borders].swapaxes(0, 1))
    axes.add_collection(LineCollection([line[:, :2] for line in borders], colors="white", lw=0.6))
    named = sample.knit.shape[1] <= MAX_NAMES
    _name_patches(axes, nodes, sample, repeat, named)
    notes = ["white lines: patch borders", *([] if named else [LETTERS])]
    if "self_intersections" in case and (crossing := int(case["self_intersections"][0])):
        notes.insert(0, f"passes through itself: {crossing} pairs of cells")
    state = "periodic, " if is_periodic(case) else ""
    state += sheets.state_text(float(case["applied_strain"][0]))
    axes.set_title("\n".join([sheets.design_text(case), state, "; ".join(notes)]), fontsize=7)
    figure.colorbar(colours, ax=axes, label=f"height z [{unit}]", shrink=0.8)
    return figure


def _name_patches(
    axes: Axes, nodes: np.ndarray, sample: "PatchGrid", repeat: tuple[int, int], named: bool
) -> None:
    """Write the knit on the patches of the repeat of the pattern nearest the middle."""
    from knitlab.model.pattern import KNIT_OF_LETTER

    look: Look = {"ha": "center", "va": "center", "color": "white", "fontsize": 8 if named else 6}
    look["path_effects"] = [withStroke(linewidth=2, foreground="black")]
    counts = np.array(sample.knit.shape)
    rows, columns = (
        (borders[:-1] + borders[1:]) // 2 for borders in (sample.row_borders, sample.column_borders)
    )
    for at in np.ndindex(repeat):
        row, column = at + repeat * ((counts // repeat - 1) // 2)
        letter = str(sample.knit[row, column])
        across, along = nodes[rows[row], columns[column], :2]
        if np.isnan(across):
            continue  # outside a shaped piece
        axes.text(across, along, KNIT_OF_LETTER[letter] if named else letter, **look)
