"""The look of every figure: print sizes, legible type, and colours for every kind of colour vision.

Colours of values are about zero if some are negative, and by decades if they span several.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

ONE_COLUMN = 85 / 25.4  # width of one journal column [in]
TWO_COLUMNS = 175 / 25.4  # width of two journal columns [in]

STRAIN_COLOURS = "RdBu_r"  # diverging colour map for signed values, white at zero
SEQUENCE_COLOURS = "viridis"  # sequential colour map for ordered values
OKABE_ITO = "#0072B2 #D55E00 #009E73 #CC79A7 #E69F00 #56B4E9 black 0.5"
CATEGORY_COLOURS = tuple(OKABE_ITO.split())  # colours of things without an order
MARKERS = "osD^vP*X"  # markers of things without an order
MINUS = "\u2212"
STRAIN_LABEL = "applied strain [1]"

DOTS_PER_INCH = 320  # resolution of PNG files, and of what vector files hold as a picture
# Ratio of the largest of positive values to their median above which colours follow decades. To the
# smallest it would depend on a single value, such as a force of 1e-10 N at zero strain.
DECADES = 30.0

PRINT: dict[Any, Any] = {
    "font.family": "sans-serif",
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7),
    **dict.fromkeys(("legend.frameon", "axes.spines.top", "axes.spines.right"), False),
    **{"axes.linewidth": 0.6, "lines.linewidth": 1.2, "hatch.linewidth": 0.5},
    **{"savefig.dpi": DOTS_PER_INCH, "pdf.fonttype": 42, "svg.fonttype": "none"},
}
print_style = partial(style.context, ["default", PRINT])
"""Settings for print, whatever those of the user, within ``with`` or a decorated function."""

Look = dict[str, Any]  # keyword arguments of an artist of matplotlib


def subplots(
    height: float, rows: int = 1, columns: int = 1, *, width: float = TWO_COLUMNS, **look: Any
) -> tuple[Figure, Any]:
    """A figure of a size [inch] with axes, or a grid of them, that share its space."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **look)


def variable_label(variable: xr.DataArray) -> str:
    """The meaning of a variable and its unit, for an axis."""
    meaning = variable.attrs.get("long_name", variable.name)
    return f"{meaning} [{variable.attrs.get('units', '1')}]"


def number(value: float, form: str = ".2f") -> str:
    """A number as text, with a true minus sign."""
    return format(value, form).replace("-", MINUS)


def shades(count: int) -> list[Any]:
    """Colours of things in an order."""
    return list(mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.8, count)))


def ink_on(colour: Any) -> str:
    """Text colour that is legible on a colour: black or white."""
    return "white" if np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) < 0.45 else "black"


def name_rows(axes: Axes, names: Sequence[str], **letters: Any) -> None:
    """Name the rows of a plot, the first of them at the top."""
    axes.set_yticks(range(len(names)), names, **letters)
    axes.set_ylim(len(names) - 0.5, -0.5)


def frame_polar(axes: PolarAxes, title: str, names: Sequence[str]) -> None:
    """Circles for the values of all lines, and directions; ``names`` are those of 0°, 45°, 90°."""
    values = np.concatenate([np.asarray(line.get_ydata()) for line in axes.lines])
    low, high = min(values.min(), 0), max(values.max(), 0)
    if low < 0:
        low -= 0.25 * (high - low)
        angles = np.linspace(0, 2 * np.pi, 181)
        axes.plot(angles, 0 * angles, color="black", lw=0.8)
    axes.set_rlim(low, high + 0.05 * (high - low))
    axes.set_title(title, pad=12)
    axes.set_thetagrids(range(0, 360, 45), [*names, *[""] * 5])
    axes.set_rlabel_position(22)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(axis="y", labelsize=6)
    axes.grid(color="0.88", lw=0.5)
    axes.spines["polar"].set_color("0.88")


def value_colours(values: np.ndarray, signed: bool = False) -> ScalarMappable:
    """Colours that span the finite values; with ``signed`` zero is white in any case."""
    finite = np.asarray(values, float)[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    norm, name = Normalize(low, high if high > low else low + 1.0), SEQUENCE_COLOURS
    if signed or low < 0:
        largest = max(abs(low), abs(high)) or 1.0
        norm, name = Normalize(-largest, largest), STRAIN_COLOURS
    elif low > 0 and high / float(np.median(finite)) > DECADES:
        norm = LogNorm(low, high)
    colours = ScalarMappable(norm, name)
    colours.set_array(np.array([low, high]))
    return colours


def colour_bar(axes: Axes | Sequence[Axes], colours: ScalarMappable, **look: Any) -> None:
    """Add a colour bar beside axes that spans the values, and nothing beyond them."""
    figure = axes.figure if isinstance(axes, Axes) else axes[0].figure
    bar = figure.colorbar(colours, ax=axes, **look)
    low, high = np.asarray(colours.get_array()).tolist()
    if low < high:
        bar.ax.set_ylim(low, high)
    else:
        bar.set_ticks([low])
