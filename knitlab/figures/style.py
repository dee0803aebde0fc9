"""The look of every figure: print sizes in mm, legible type, colour-blind-safe colours."""

from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib as mpl

ONE_COLUMN = 85 / 25.4
"""Width of one journal column [in]."""
TWO_COLUMNS = 175 / 25.4
"""Width of two journal columns [in]."""

STRAIN_COLOURS = "RdBu_r"
"""Diverging colour map for signed values, white at zero."""
SEQUENCE_COLOURS = "viridis"
"""Sequential colour map for ordered values."""


@contextmanager
def print_style() -> Iterator[None]:
    """Matplotlib settings for print, restored afterwards."""
    with mpl.rc_context(
        {
            "backend": "Agg",
            "font.family": "sans-serif",
            "font.size": 8,
            "axes.titlesize": 8,
            "axes.labelsize": 8,
            "legend.fontsize": 7,
            "xtick.labelsize": 7,
            "ytick.labelsize": 7,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.linewidth": 0.6,
            "lines.linewidth": 1.2,
            "hatch.linewidth": 0.5,
            "savefig.dpi": 200,
            "pdf.fonttype": 42,
            "svg.fonttype": "none",
        }
    ):
        yield
