"""The stitch chart: the bed of every stitch, patches, electrodes and the repeat."""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from knitlab.figures.style import TWO_COLUMNS
from knitlab.knitting.chart import StitchChart, electrode_name

FRONT, BACK = "white", "0.68"
ELECTRODES = {1: ("#FAD7A0", "#DC7633"), 2: ("#AED6F1", "#2471A3")}
"""Colours of the plated stitches of electrodes, on the front and on the back bed."""
WIDEST_STITCH = 0.16
"""Width of a stitch in a small chart [in]."""
NARROWEST_MARKED = 0.045
"""Width of a stitch from which on purls have a mark of their own [in]."""
MOST_DRAWN = (256, 128)
"""Courses and wales up to which more than one repeat is drawn."""
WORD = 0.6
"""Width of a patch from which on its knit is named by a word, else by its letter [in]."""
MARGIN = 0.7
"""Room for the numbers of an axis [in]."""


def stitch_chart_figure(chart: StitchChart) -> Figure:
    """Every stitch of a chart, seen from the front; of a large one, one repeat.

    Args:
        chart: the chart.
    """
    rows, columns = drawn_part(chart)
    courses, wales = rows.stop - rows.start, columns.stop - columns.start
    stitch = min(WIDEST_STITCH, (TWO_COLUMNS - MARGIN) / wales)
    # A stitch is drawn twice as wide as high, as it is.
    size = (TWO_COLUMNS, stitch * courses / 2 + 2 * MARGIN + 0.55)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    draw_chart(axes, chart, stitch)
    figure.legend(handles=legend_handles(chart), loc="outside lower left", ncols=2, frameon=False)
    figure.suptitle(title_of(chart), fontsize="medium")
    return figure


def title_of(chart: StitchChart) -> str:
    """Design and size of a chart, and which part of it is drawn."""
    part = drawn_part(chart)
    along_y, along_x = chart.repeats
    title = f"{chart.title}: {chart.courses} courses of {chart.wales} wales"
    if part != (slice(0, chart.courses), slice(0, chart.wales)):
        title += f"; one of {along_y} × {along_x} repeats is drawn"
    return title


def drawn_part(chart: StitchChart) -> tuple[slice, slice]:
    """Courses and wales that are drawn: all, or of a large chart the repeat with most electrode."""
    if chart.courses <= MOST_DRAWN[0] and chart.wales <= MOST_DRAWN[1]:
        return slice(0, chart.courses), slice(0, chart.wales)
    (height, width), (along_y, along_x) = chart.repeat, chart.repeats
    blocks = chart.plated.reshape(along_y, height, along_x, width)
    plated = (blocks > 0).sum(axis=(1, 3))
    row, column = np.unravel_index(np.argmax(plated), plated.shape)
    y, x = int(row) * height, int(column) * width
    return slice(y, y + height), slice(x, x + width)


def draw_chart(axes: Axes, chart: StitchChart, stitch: float) -> None:
    """Draw a chart, or one repeat of it.

    Args:
        axes: where.
        chart: the chart.
        stitch: width of a stitch on paper [in].
    """
    rows, columns = drawn_part(chart)
    front, plated = chart.front[rows, columns], chart.plated[rows, columns]
    colours = np.where(front[..., None], to_rgb(FRONT), to_rgb(BACK))
    for number, (on_front, on_back) in ELECTRODES.items():
        of_bed = np.where(front[..., None], to_rgb(on_front), to_rgb(on_back))
        colours = np.where((plated == number)[..., None], of_bed, colours)
    extent = (columns.start, columns.stop, rows.start, rows.stop)
    axes.imshow(colours, origin="lower", extent=extent, aspect=0.5, interpolation="nearest")
    if stitch >= NARROWEST_MARKED:
        _draw_stitches(axes, front, rows, columns, stitch)
    _draw_patches(axes, chart, rows, columns, stitch)
    _draw_electrodes(axes, chart, rows, columns)
    _draw_repeat(axes, chart, rows, columns)
    axes.set(
        xlim=extent[:2],
        ylim=extent[2:],
        xlabel="wale, numbered as its needle",
        ylabel="course, in the order of knitting",
    )
    for axis, start, stop in ((axes.xaxis, *extent[:2]), (axes.yaxis, *extent[2:])):
        # A number stands at the middle of its stitch.
        wanted = {start + 1, stop, *MaxNLocator(8, integer=True).tick_values(start, stop)}
        numbers = _apart([int(n) for n in sorted(wanted) if start < n <= stop], stop - start)
        axis.set_ticks([number - 0.5 for number in numbers], [str(n) for n in numbers])
    axes.spines[:].set_visible(True)


def legend_handles(chart: StitchChart) -> list[Patch | Line2D]:
    """What the marks of a chart mean."""
    edge: dict[str, Any] = {"edgecolor": "0.3", "linewidth": 0.5}
    handles: list[Patch | Line2D] = [
        Patch(facecolor=FRONT, label="knit on the front bed: face stitch (knit)", **edge),
        Patch(facecolor=BACK, label="knit on the back bed: reverse stitch (purl)", **edge),
    ]
    for number in chart.electrodes:
        face = chart.plated_face[number - 1]
        label = (
            f"electrode {electrode_name(number)}, outlined: conductor on the {face}; darker: purl"
        )
        handles.append(Patch(facecolor=ELECTRODES[number][0], label=label, **edge))
    handles.append(Line2D([], [], color="black", linewidth=1.0, label="border of a patch"))
    part = "edge of the sample" if chart.is_whole_sample else "repeat"
    handles.append(Line2D([], [], color="black", linewidth=1.6, linestyle=(0, (4, 2)), label=part))
    return handles


def _draw_stitches(
    axes: Axes, front: np.ndarray, rows: slice, columns: slice, stitch: float
) -> None:
    """A dash for every purl, and thin lines between stitches."""
    axes.hlines(
        np.arange(rows.start + 1, rows.stop), columns.start, columns.stop, colors="0.85", lw=0.25
    )
    axes.vlines(
        np.arange(columns.start + 1, columns.stop), rows.start, rows.stop, colors="0.85", lw=0.25
    )
    course, wale = np.nonzero(~front)
    middle = rows.start + course + 0.5, columns.start + wale
    axes.hlines(
        middle[0], middle[1] + 0.3, middle[1] + 0.7, colors="black", lw=4 * stitch, alpha=0.8
    )


def _draw_patches(
    axes: Axes, chart: StitchChart, rows: slice, columns: slice, stitch: float
) -> None:
    ys = [y for y in chart.row_borders.tolist() if rows.start <= y <= rows.stop]
    xs = [x for x in chart.column_borders.tolist() if columns.start <= x <= columns.stop]
    style: dict[str, Any] = {"colors": "black", "lw": 1.0}
    axes.hlines(ys, columns.start, columns.stop, **style)
    axes.vlines(xs, rows.start, rows.stop, **style)
    for y, above in pairwise(ys):
        for x, right in pairwise(xs):
            row = int(np.searchsorted(chart.row_borders, y, side="right")) - 1
            column = int(np.searchsorted(chart.column_borders, x, side="right")) - 1
            knit = str(chart.knit[row, column])
            axes.text(
                (x + right) / 2,
                (y + above) / 2,
                knit if (right - x) * stitch > WORD else knit[0].upper(),
                ha="center",
                va="center",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )


def _draw_electrodes(axes: Axes, chart: StitchChart, rows: slice, columns: slice) -> None:
    """The outline of every electrode, and its letter at its lower end."""
    plated = chart.plated[rows, columns]
    course, wale = np.nonzero(plated[:, 1:] != plated[:, :-1])
    x, y = columns.start + wale + 1, rows.start + course
    axes.vlines(x, y, y + 1, colors="black", lw=1.4)
    course, wale = np.nonzero(plated[1:] != plated[:-1])
    x, y = columns.start + wale, rows.start + course + 1
    axes.hlines(y, x, x + 1, colors="black", lw=1.4)
    for number in chart.electrodes:
        places = np.argwhere(plated == number)
        if not len(places):
            continue
        lowest = int(places[:, 0].min())
        middle = float(places[places[:, 0] == lowest, 1].mean())
        axes.text(
            columns.start + middle + 0.5,
            rows.start + lowest + 0.02 * (rows.stop - rows.start),
            electrode_name(number),
            ha="center",
            va="bottom",
            fontweight="bold",
            bbox={"facecolor": "white", "edgecolor": "black", "linewidth": 0.6, "pad": 1.5},
            zorder=4,
        )


def _draw_repeat(axes: Axes, chart: StitchChart, rows: slice, columns: slice) -> None:
    height, width = chart.repeat
    part = "whole sample" if chart.is_whole_sample else "repeat"
    axes.add_patch(
        Rectangle(
            (columns.start, rows.start),
            width,
            height,
            fill=False,
            linewidth=1.6,
            linestyle=(0, (4, 2)),
            zorder=3,
            clip_on=False,
        )
    )
    axes.annotate(
        f"{part}: {width} wales",
        (columns.start + width / 2, rows.stop),
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        annotation_clip=False,
    )
    axes.annotate(
        f"{part}: {height} courses",
        (columns.stop, rows.start + height / 2),
        xytext=(4, 0),
        textcoords="offset points",
        ha="left",
        va="center",
        rotation=90,
        annotation_clip=False,
    )


def _apart(numbers: list[int], span: int) -> list[int]:
    """Numbers without those too near to the first or the last."""
    near = span / 16
    first, *between = numbers
    if not between:
        return numbers
    *between, last = between
    kept = [number for number in between if number - first > near and last - number > near]
    return [first, *kept, last]
