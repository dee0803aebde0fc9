"""Relaxed shapes of several designs side by side (paper, Fig. "relaxed configurations")."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.kinds.shape import whole_sheet
from knitlab.figures.perspective import FOLDED_SHEET_FITS, draw_sheet, frame_sheet
from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS

PAPER_SHAPES = ((4, 16), (2, 32), (2, 16))
HEIGHT = 2.6
"""Height of the figure [in]."""


def relaxed_shapes(cases: Sequence[xr.Dataset]) -> Figure:
    """Relaxed shapes of several designs side by side (paper, Fig. "relaxed configurations").

    Each fills its frame and is labelled with its size.

    Args:
        cases: contents of case files, with node positions; of periodic fabric a few cells are
            drawn.
    """
    sheets = [whole_sheet(case) for case in cases]
    for sheet in sheets:
        sheet[..., 2] -= (sheet[..., 2].min() + sheet[..., 2].max()) / 2
    highest = max(float(np.abs(sheet[..., 2]).max()) for sheet in sheets)
    norm = mpl.colors.Normalize(-highest, highest)
    figure = Figure(figsize=(TWO_COLUMNS, HEIGHT))
    width = 0.88 / len(sheets)
    for place, (case, sheet) in enumerate(zip(cases, sheets, strict=True)):
        scene = figure.add_axes((place * width, 0.0, width, 0.88), projection="3d")
        draw_sheet(scene, sheet, norm)
        frame_sheet(scene, sheet, FOLDED_SHEET_FITS)
        across, along = np.ptp(sheet[..., :2], axis=(0, 1))
        title = f"({int(case['n_stripe'])}, {int(case['n_subunit'])})"
        figure.text(
            (place + 0.5) * width,
            0.9,
            f"{title}\n{across:.0f} × {along:.0f} mm",
            ha="center",
            va="center",
        )
    bar = figure.add_axes((0.9, 0.15, 0.012, 0.6))
    figure.colorbar(mpl.cm.ScalarMappable(norm, SEQUENCE_COLOURS), cax=bar, label="height z [mm]")
    return figure


FIGURE = FigureKind(relaxed_shapes, needs="position", designs=PAPER_SHAPES)
