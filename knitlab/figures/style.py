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
CATEGORY_COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "black",
    "0.5",
)
"""Colours of things without an order, by Okabe and Ito."""
MINUS = "\u2212"

DOTS_PER_INCH = 320
"""Resolution of PNG files, and of what vector files hold as a picture."""


def number(value: float, form: str = ".2f") -> str:
    """A number as text, with a true minus sign."""
    return format(value, form).replace("-", MINUS)


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
            "savefig.dpi": DOTS_PER_INCH,
            "pdf.fonttype": 42,
            "svg.fonttype": "none",
        }
    ):
        yield
