"""The look of every figure: print sizes, legible type, and colours for every kind of colour vision.

Colours of values are about zero if some are negative, and by decades if they span several.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ONE_COLUMN = 85 / 25.4  # width of one journal column [in]
TWO_COLUMNS = 175 / 25.4  # width of two journal columns [in]

STRAIN_COLOURS = "RdBu_r"  # diverging colour map for signed values, white at zero
SEQUENCE_COLOURS = "viridis"  # sequential colour map for ordered values
OKABE_ITO = "#0072B2 #D55E00 #009E73 #CC79A7 #E69F00 #56B4E9 black 0.5"
CATEGORY_COLOURS = tuple(OKABE_ITO.split())  # colours of things without an order
MARKERS = "osD^vP*X"  # markers of things without an order
MINUS = "\u2212"

DOTS_PER_INCH = 320  # resolution of PNG files, and of what vector files hold as a picture
# Ratio of the largest of positive values to their median above which colours follow decades. To the
# smallest it would depend on a single value, such as a force of 1e-10 N at zero strain.
DECADES = 30.0

PRINT: dict[Any, Any] = {
    **{"backend": "Agg", "font.family": "sans-serif"},
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7),
    **dict.fromkeys(("legend.frameon", "axes.spines.top", "axes.spines.right"), False),
    **{"axes.linewidth": 0.6, "lines.linewidth": 1.2, "hatch.linewidth": 0.5},
    **{"savefig.dpi": DOTS_PER_INCH, "pdf.fonttype": 42, "svg.fonttype": "none"},
}
"""Settings of matplotlib for print."""

Colour = tuple[float, float, float, float]
Look = dict[str, Any]  # keyword arguments of an artist of matplotlib


def number(value: float, form: str = ".2f") -> str:
    """A number as text, with a true minus sign."""
    return format(value, form).replace("-", MINUS)


def shades(count: int, end: float = 0.8) -> list[Any]:
    """Colours of things in an order."""
    return list(mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, end, count)))


def ink_on(colour: tuple[float, ...]) -> str:
    """Text colour that is legible on a colour: black or white."""
    luminance = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return "white" if luminance < 0.45 else "black"


def name_rows(axes: Axes, names: Sequence[str], **letters: Any) -> None:
    """Name the rows of a plot, the first of them at the top."""
    axes.set_yticks(range(len(names)), names, **letters)
    axes.set_ylim(len(names) - 0.5, -0.5)


def print_style() -> AbstractContextManager[None]:
    """Matplotlib settings for print, restored afterwards."""
    return mpl.rc_context(PRINT)


@dataclass(frozen=True)
class ValueColours:
    """Colours of values between ``low`` and ``high``."""

    norm: mpl.colors.Normalize
    colours: mpl.colors.Colormap
    low: float
    high: float

    @classmethod
    def of(cls, values: np.ndarray, signed: bool = False) -> "ValueColours":
        """Colours that span the finite values; with ``signed`` zero is white in any case."""
        finite = np.asarray(values, float)[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        if signed or low < 0:
            largest = max(abs(low), abs(high)) or 1.0
            norm = mpl.colors.Normalize(-largest, largest)
            return cls(norm, mpl.colormaps[STRAIN_COLOURS], low, high)
        if low > 0 and high / float(np.median(finite)) > DECADES:
            norm = mpl.colors.LogNorm(low, high)
        else:
            norm = mpl.colors.Normalize(low, high if high > low else low + 1.0)
        return cls(norm, mpl.colormaps[SEQUENCE_COLOURS], low, high)

    def __call__(self, value: float) -> Colour:
        """The colour of a value."""
        red, green, blue, opacity = self.colours(self.norm(value))
        return red, green, blue, opacity

    def bar(self, figure: Figure, axes: Axes | list[Axes], **look: Any) -> None:
        """Add a colour bar beside axes that spans the values, and nothing beyond them."""
        bar = figure.colorbar(mpl.cm.ScalarMappable(self.norm, self.colours), ax=axes, **look)
        if self.low < self.high:
            bar.ax.set_ylim(self.low, self.high)
        else:
            bar.set_ticks([self.low])
