"""The look of every figure: print sizes, legible type, and colours for every kind of colour vision.

Colours of values are about zero if some are negative, by decades if they span several, and begin at
zero if they differ by less than half of the largest.
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
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

ONE_COLUMN = 85 / 25.4  # width of one journal column [in]
TWO_COLUMNS = 175 / 25.4  # width of two journal columns [in]

# For signed values: from blue through near white at zero to orange, in equal steps of lightness on
# both sides; the two hues differ for every kind of colour vision.
STRAIN_COLOURS = LinearSegmentedColormap.from_list("signed", ("#185aa7", "#f5f5f5", "#983700"))
SIGNED = ("poisson_ratio", "strain_xx", "mean_strain_xx")  # how such variables begin
SEQUENCE_COLOURS = "viridis"  # sequential colour map for ordered values
OKABE_ITO = "#0072B2 #D55E00 #009E73 #CC79A7 #E69F00 #56B4E9 black 0.5"
CATEGORY_COLOURS = tuple(OKABE_ITO.split())  # colours of things without an order
MARKERS = "osD^vP*X"  # markers of things without an order
MINUS = "\u2212"
STRAIN_LABEL = "applied strain [1]"

ROOM_AROUND = 0.3  # of panels, for a line of text [inch]
DOTS_PER_INCH = 320  # resolution of PNG files, and of what vector files hold as a picture
# Ratio of the largest of positive values to their median above which colours follow decades. To the
# smallest it would depend on a single value, such as a force of 1e-10 N at zero strain.
DECADES = 30.0
# Ratio of the least of positive values to the largest from which colours begin at zero, so that
# what hardly differs looks alike.
SMALL_SPREAD = 0.5

PRINT: dict[Any, Any] = {
    "font.family": "sans-serif",
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 8),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7),
    **dict.fromkeys(("legend.frameon", "axes.spines.top", "axes.spines.right"), False),
    **{"axes.linewidth": 0.6, "lines.linewidth": 1.2, "hatch.linewidth": 0.5},
    # Of the figure, too, so that its own ``savefig`` has the resolution of ``knitlab map``.
    **dict.fromkeys(("figure.dpi", "savefig.dpi"), DOTS_PER_INCH),
    **{"pdf.fonttype": 42, "svg.fonttype": "none"},
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


def fit_height(figure: Figure, row: Sequence[Axes]) -> None:
    """Reduce a figure to the height of a row of panels of equal scales, which leave room around."""
    figure.draw_without_rendering()
    boxes = (axes.get_tightbbox() for axes in row)
    panels = Bbox.union([box for box in boxes if box is not None])
    figure.set_figheight(min(panels.height / figure.dpi + ROOM_AROUND, figure.get_figheight()))


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
    low -= 0.25 * (high - low) * (low < 0)
    axes.set_rlim(low, high + 0.05 * (high - low))
    axes.set_title(title, pad=12)
    _, (rightmost, *_) = axes.set_thetagrids(range(0, 360, 45), [*names, *[""] * 5])
    rightmost.set_horizontalalignment("left")
    axes.yaxis.set_major_locator(MaxNLocator(4))
    _place_values(axes)
    if low < 0:
        angles = np.linspace(0, 2 * np.pi, 181)
        axes.plot(angles, 0 * angles, color="black", lw=0.8)
    axes.grid(color="0.88", lw=0.5)
    axes.spines["polar"].set_color("0.88")


def _place_values(axes: PolarAxes) -> None:
    """Write the values of the circles where they are farthest from all curves, and above these."""
    angles = np.deg2rad([*range(10, 81, 5), *range(100, 171, 5)])
    values = [value for value in map(float, axes.get_yticks()) if value <= axes.get_rmax()]
    apart = np.full(len(angles), np.inf)
    for line in axes.lines:
        around, radius = np.asarray(line.get_data(), float)
        radii = np.interp(angles, around, radius, period=2 * np.pi)
        apart = np.minimum(apart, np.abs(radii[:, None] - values).min(axis=1))
    at = angles[np.argmax(apart)]
    box: Look = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    for value, text in zip(
        values, axes.yaxis.get_major_formatter().format_ticks(values), strict=True
    ):
        axes.text(at, value, text, fontsize=6, ha="center", va="center", bbox=box, zorder=4)
    axes.set_yticklabels([])


def is_signed(name: str) -> bool:
    """Whether a variable can be negative, so that zero is white even if no value is."""
    return name.startswith(SIGNED)


def value_colours(values: np.ndarray, signed: bool = False) -> ScalarMappable:
    """Colours that span the finite values; with ``signed`` zero is white in any case."""
    finite = np.asarray(values, float)[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if low > SMALL_SPREAD * high:
        low = 0.0
    norm: Normalize = Normalize(low, high if high > low else low + 1.0)
    shown: str | Colormap = SEQUENCE_COLOURS
    if signed or low < 0:
        largest = max(abs(low), abs(high)) or 1.0
        norm = Normalize(-largest, largest)
        shown = STRAIN_COLOURS
    elif low > 0 and high / float(np.median(finite)) > DECADES:
        norm = LogNorm(low, high)
    colours = ScalarMappable(norm, shown)
    colours.set_array(np.array([low, high]))
    return colours


def colour_bar(axes: Axes | Sequence[Axes], colours: ScalarMappable, **look: Any) -> None:
    """Add a colour bar beside axes that spans the values, and nothing beyond; none for no values.

    That of a single value begins at zero.
    """
    low, high = np.asarray(colours.get_array()).tolist()
    if low == high:
        low, high = min(low, 0.0), max(high, 0.0)
    if low < high:
        figure = axes.figure if isinstance(axes, Axes) else axes[0].figure
        figure.colorbar(colours, ax=axes, **look).ax.set_ylim(low, high)
