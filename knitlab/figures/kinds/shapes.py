"""Shapes of several designs side by side (paper, Fig. "relaxed configurations")."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.kinds.shape import whole_sheet
from knitlab.figures.perspective import draw_sheet, frame_sheet
from knitlab.figures.style import TWO_COLUMNS

PAPER_SHAPES = ((4, 16), (2, 32), (2, 16))
HEIGHT = 2.7
"""Height of the figure [in]."""
FEWEST = 2
"""Smallest number of frames that the width is divided into."""
NOTE = "(n_stripe, n_subunit); size along weft and warp, and height"


def relaxed_shapes(cases: Sequence[xr.Dataset]) -> Figure:
    """Shapes of several designs side by side (paper, Fig. "relaxed configurations").

    They are relaxed, or at ``applied_strain``. Each fills its frame and is labelled with its size.

    Args:
        cases: contents of case files, with node positions; of periodic fabric a few cells are
            drawn.
    """
    figure = Figure(figsize=(TWO_COLUMNS, HEIGHT))
    width = 1 / max(len(cases), FEWEST)
    first = (1 - width * len(cases)) / 2
    for place, case in enumerate(cases):
        sheet = whole_sheet(case)
        left = first + place * width
        scene = figure.add_axes((left, 0.0, width, 0.8), projection="3d")
        draw_sheet(scene, sheet)
        frame_sheet(scene, sheet)
        size = " × ".join(f"{extent:.3g}" for extent in np.ptp(sheet, axis=(0, 1)))
        strain = float(case["applied_strain"][0])
        state = f"pulled {strain:.0%}" if strain else "relaxed"
        figure.text(
            left + width / 2,
            0.9,
            f"({int(case['n_stripe'])}, {int(case['n_subunit'])}), {state}\n{size} mm",
            ha="center",
            va="center",
        )
    figure.text(0.5, 0.01, NOTE, ha="center", fontsize="small")
    return figure


FIGURE = FigureKind(
    relaxed_shapes, needs="position", designs=PAPER_SHAPES, coordinates=("applied_strain",)
)
