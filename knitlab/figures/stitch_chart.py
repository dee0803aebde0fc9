"""The stitch chart of a sample, and its specification sheet: one page for the knitter."""

import textwrap
from collections.abc import Sequence
from datetime import date
from importlib.metadata import version
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from knitlab.export.knitting.chart import StitchChart, electrode_name
from knitlab.figures.style import STRAIN_LABEL, TWO_COLUMNS, Look, print_style

if TYPE_CHECKING:
    from knitlab.export.knitting.leads import Lead
    from knitlab.export.knitting.specification import Prediction, Specification

FRONT, BACK = "white", "0.68"
ELECTRODES = {1: ("#FAD7A0", "#DC7633"), 2: ("#AED6F1", "#2471A3")}
"""Colours of the plated stitches of electrodes, on the front and on the back bed."""
MIN_MARKED_WIDTH = 0.045  # width of a stitch from which on purls have a mark of their own [in]
MAX_DRAWN = (256, 128)  # courses and wales up to which more than one repeat is drawn
WORD = 0.6  # width of a patch from which on its knit is named by a word, else by its letter [in]
MARGIN = 0.7  # room for the numbers of an axis [in]
REPEAT: Look = {"linewidth": 1.6, "linestyle": (0, (4, 2))}  # around the repeat, or the sample
LED = (0, (2, 1.5))  # dashes of yarn that is led to an edge over the back
BEYOND = 8.0  # length of the end of a yarn beyond an edge [pt]
OUTWARD = {"lower": (0, -1), "upper": (0, 1), "left": (-1, 0), "right": (1, 0)}
"""Directions out of the fabric at its edges, along the chart's (x, y)."""
A4 = 210 / 25.4, 297 / 25.4  # width and height of the specification sheet [in]
NOTE = """Sizes are of cloth, by the gauge;
times by the speeds in machine.toml.
Both are estimates."""


@print_style()
def stitch_chart_figure(chart: StitchChart, leads: Sequence["Lead"] = ()) -> Figure:
    """Every stitch of a chart, or of one repeat of a large one, and the ends of its electrodes."""
    rows, columns = drawn_block(chart)
    stitch = min(0.16, (TWO_COLUMNS - MARGIN) / (columns.stop - columns.start))
    # A stitch is drawn twice as wide as high, as it is.
    height = stitch * (rows.stop - rows.start) / 2 + 2 * MARGIN + 0.55
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    draw_chart(figure.subplots(), chart, stitch, leads)
    figure.legend(handles=legend_handles(chart, leads), loc="outside lower left", ncols=2)
    figure.suptitle(chart_title(chart), fontsize="medium")
    return figure


def chart_title(chart: StitchChart) -> str:
    """Design and size of a chart, and what of it is drawn."""
    along_y, along_x = chart.repeats
    title = f"{chart.title}: {chart.courses} courses of {chart.wales} wales"
    if drawn_block(chart) != (slice(0, chart.courses), slice(0, chart.wales)):
        title += f"; one of {along_y} × {along_x} repeats is drawn"
    return title


def drawn_block(chart: StitchChart) -> tuple[slice, slice]:
    """Courses and wales that are drawn: all, or of a large chart the repeat with most electrode."""
    if chart.courses <= MAX_DRAWN[0] and chart.wales <= MAX_DRAWN[1]:
        return slice(0, chart.courses), slice(0, chart.wales)
    (height, width), (along_y, along_x) = chart.repeat, chart.repeats
    plated = (chart.plated.reshape(along_y, height, along_x, width) > 0).sum(axis=(1, 3))
    row, column = np.unravel_index(np.argmax(plated), plated.shape)
    y, x = int(row) * height, int(column) * width
    return slice(y, y + height), slice(x, x + width)


def draw_chart(axes: Axes, chart: StitchChart, stitch: float, leads: Sequence["Lead"] = ()) -> None:
    """Draw a chart, or one repeat of it, with stitches of a width on paper [in]."""
    rows, columns = drawn_block(chart)
    front, plated = chart.front[rows, columns], chart.plated[rows, columns]
    colours = np.where(front[..., None], to_rgb(FRONT), to_rgb(BACK))
    for electrode, (on_front, on_back) in ELECTRODES.items():
        bed_colours = np.where(front[..., None], to_rgb(on_front), to_rgb(on_back))
        colours = np.where((plated == electrode)[..., None], bed_colours, colours)
    extent = (columns.start, columns.stop, rows.start, rows.stop)
    axes.imshow(colours, origin="lower", extent=extent, aspect=0.5, interpolation="nearest")
    left, right, low, high = extent
    if stitch >= MIN_MARKED_WIDTH:
        # Thin lines between stitches, and a dash for every purl.
        axes.hlines(np.arange(low + 1, high), left, right, colors="0.85", lw=0.25)
        axes.vlines(np.arange(left + 1, right), low, high, colors="0.85", lw=0.25)
        course, wale = np.nonzero(~front)
        y, x = low + course + 0.5, left + wale
        axes.hlines(y, x + 0.3, x + 0.7, colors="black", lw=4 * stitch, alpha=0.8)
    _draw_patches(axes, chart, extent, stitch)
    _draw_electrodes(axes, chart, plated, extent)
    beyond = _draw_leads(axes, leads, extent)
    (height, width), named = chart.repeat, "whole sample" if chart.is_whole_sample else "repeat"
    outline: Patch = Rectangle((left, low), width, height)
    if chart.spans is not None:
        outline = _outline(chart.spans[rows], low)
        for artist in (*axes.images, *axes.collections):
            artist.set_clip_path(outline.get_path(), axes.transData)
    outline.set(fill=False, zorder=3, clip_on=False, **REPEAT)
    axes.add_patch(outline)
    beside: Look = {"textcoords": "offset points", "annotation_clip": False}
    above: Look = {"xytext": (0, 4 + beyond["upper"]), "ha": "center", "va": "bottom"} | beside
    beside |= {"xytext": (4 + beyond["right"], 0), "ha": "left", "va": "center", "rotation": 90}
    axes.annotate(f"{named}: {width} wales", (left + width / 2, high), **above)
    axes.annotate(f"{named}: {height} courses", (right, low + height / 2), **beside)
    axes.set(xlim=(left, right), ylim=(low, high))
    axes.set(xlabel="wale, numbered as its needle", ylabel="course, in the order of knitting")
    for axis, start, stop in ((axes.xaxis, left, right), (axes.yaxis, low, high)):
        # The first and the last are numbered, and others that are not too near to these.
        near = (stop - start) / 16
        others = MaxNLocator(8, integer=True).tick_values(start, stop)
        numbers = [int(n) for n in others if start + 1 + near < n < stop - near]
        numbers = [start + 1, *numbers, stop]
        # A number stands at the middle of its stitch.
        axis.set_ticks([number - 0.5 for number in numbers], [str(n) for n in numbers])
    axes.xaxis.set_tick_params(pad=3 + beyond["lower"])
    axes.yaxis.set_tick_params(pad=3 + beyond["left"])
    axes.spines[:].set_visible(chart.spans is None)


def _outline(spans: np.ndarray, low: int) -> Polygon:
    """The edge of a shaped piece, with courses from ``low`` up."""
    heights = np.repeat(np.arange(low, low + len(spans) + 1), 2)[1:-1]
    sides = [np.stack([np.repeat(wales, 2), heights], axis=1) for wales in spans.T]
    return Polygon(np.concatenate([sides[0], sides[1][::-1]]))


def legend_handles(chart: StitchChart, leads: Sequence["Lead"] = ()) -> list[Patch | Line2D]:
    """What the marks of a chart mean."""
    colours = {"knit on the front bed: face stitch (knit)": FRONT}
    colours["knit on the back bed: reverse stitch (purl)"] = BACK
    for electrode in chart.electrodes:
        face = chart.plated_face[electrode - 1]
        label = f"electrode {electrode_name(electrode)}, outlined: conductor on the {face}"
        colours[f"{label}; darker: purl"] = ELECTRODES[electrode][0]
    outline = "edge of the sample" if chart.is_whole_sample else "repeat"
    ends: Look = {"color": "black", "lw": 0.9, "markersize": 4}
    lead_handles = [
        Line2D([], [], label="conductive yarn is brought in", marker="o", **ends),
        Line2D([], [], label="conductive yarn is cut", marker="s", **ends),
    ]
    if any(lead.distance for lead in leads):
        inside = "end to lead to the edge"
        lead_handles.append(Line2D([], [], label=inside, color="black", lw=0.9, ls=LED))
    return [
        *(Patch(fc=colour, ec="0.3", lw=0.5, label=label) for label, colour in colours.items()),
        Line2D([], [], color="black", linewidth=1.0, label="border of a patch"),
        Line2D([], [], color="black", label=outline, **REPEAT),
        *(lead_handles if leads else []),
    ]


Extent = tuple[int, int, int, int]  # first and last wale and course drawn, as borders of stitches


def _draw_patches(axes: Axes, chart: StitchChart, extent: Extent, stitch: float) -> None:
    left, right, low, high = extent
    rows, columns = chart.row_borders.tolist(), chart.column_borders.tolist()
    ys = [y for y in rows if low <= y <= high]
    xs = [x for x in columns if left <= x <= right]
    axes.hlines(ys, left, right, colors="black", lw=1.0)
    axes.vlines(xs, low, high, colors="black", lw=1.0)
    present = chart.present
    for y, above in pairwise(ys):
        for x, beside in pairwise(xs):
            here = np.argwhere(present[y:above, x:beside]) + 0.5
            if not len(here):
                continue
            knit = str(chart.knit[rows.index(y), columns.index(x)])
            name = knit if (beside - x) * stitch > WORD else knit[0].upper()
            box: Look = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
            middle = here.mean(axis=0)
            if chart.spans is not None:
                middle = here[np.argmin(np.hypot(*(here - middle).T))]
            row, column = middle
            axes.text(x + column, y + row, name, ha="center", va="center", bbox=box)


def _draw_electrodes(axes: Axes, chart: StitchChart, plated: np.ndarray, extent: Extent) -> None:
    left, _, low, high = extent
    course, wale = np.nonzero(plated[:, 1:] != plated[:, :-1])
    axes.vlines(left + wale + 1, low + course, low + course + 1, colors="black", lw=1.4)
    course, wale = np.nonzero(plated[1:] != plated[:-1])
    axes.hlines(low + course + 1, left + wale, left + wale + 1, colors="black", lw=1.4)
    for electrode in chart.electrodes:
        courses, wales = np.nonzero(plated == electrode)
        if len(courses):
            x = left + wales[courses == courses.min()].mean() + 0.5
            y = low + courses.min() + 0.02 * (high - low)
            box: Look = {"fc": "white", "ec": "black", "lw": 0.6, "pad": 1.5}
            look: Look = {"ha": "center", "va": "bottom", "fontweight": "bold", "bbox": box}
            axes.text(x, y, electrode_name(electrode), zorder=4, **look)


def _draw_leads(axes: Axes, leads: Sequence["Lead"], extent: Extent) -> dict[str, float]:
    """Draw the ends of yarns within an extent; how far they reach beyond each edge [pt]."""
    left, right, low, high = extent
    beyond = dict.fromkeys(OUTWARD, 0.0)
    for lead in leads:
        if not (left <= lead.wale < right and low <= lead.course < high):
            continue
        x, y = lead.wale + 0.5, lead.course + 0.5
        end = {"left": (left, y), "right": (right, y), "lower": (x, low), "upper": (x, high)}
        (at_x, at_y), (along_x, along_y) = end[lead.edge], OUTWARD[lead.edge]
        colour = ELECTRODES[lead.electrode][1]
        line: Look = {"color": colour, "lw": 1.4, "clip_on": False, "zorder": 5}
        axes.plot([x, at_x], [y, at_y], ls=LED if lead.distance else "-", **line)
        tip = f"{electrode_name(lead.electrode)} {'in' if lead.enters else 'out'}"
        arrow: Look = {"arrowstyle": "-", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
        axes.annotate(
            tip,
            (at_x, at_y),
            (BEYOND * along_x, BEYOND * along_y),
            textcoords="offset points",
            ha={-1: "right", 0: "center", 1: "left"}[along_x],
            va={-1: "top", 0: "center", 1: "bottom"}[along_y],
            arrowprops=arrow,
            annotation_clip=False,
            color=colour,
            fontsize="small",
        )
        marker = "o" if lead.enters else "s"
        axes.plot([x], [y], marker=marker, mfc=colour, mec="black", ms=4, clip_on=False, zorder=6)
        beyond[lead.edge] = BEYOND + (7 if along_y else 16)
    return beyond


@print_style()
def specification_sheet(specification: "Specification") -> Figure:
    """One page A4: what a sample takes to knit, its chart, and what is predicted of it."""
    figure, chart = Figure(figsize=A4), specification.chart
    figure.text(0.07, 0.955, "Specification of a knitted sample", fontsize=14, weight="bold")
    written = f"knitlab {version('knitlab')}, {date.today().isoformat()}"
    figure.text(0.93, 0.955, written, ha="right", fontsize=8, color="0.3")
    rows = [(name, textwrap.wrap(value, 78) or [""]) for name, value in specification.rows()]
    # All end above the chart.
    y, spacing = 0.925, min(0.0165, 0.345 / sum(len(lines) for _, lines in rows))
    for name, lines in rows:
        figure.text(0.07, y, name, fontsize=9, color="0.3", va="top")
        figure.text(0.24, y, "\n".join(lines), fontsize=9, va="top")
        y -= spacing * len(lines)
    _, columns = drawn_block(chart)
    axes = figure.add_axes((0.1, 0.12, 0.54, 0.4))
    axes.set_anchor("NW")
    draw_chart(axes, chart, 4.4 / (columns.stop - columns.start), specification.leads)
    figure.text(0.07, 0.565, f"Chart, seen from the front. {chart_title(chart)}", fontsize=9)
    at: Look = {"loc": "lower left", "bbox_to_anchor": (0.06, 0.018)}
    figure.legend(handles=legend_handles(chart, specification.leads), ncols=2, **at)
    _draw_prediction(figure.add_axes((0.75, 0.32, 0.2, 0.18)), specification.prediction)
    remarks = [f"Warning: {warning}" for warning in specification.warnings]
    remarks += specification.remarks
    remarks = [line for remark in remarks for line in textwrap.wrap(remark, 34)]
    top, count = 0.42 if specification.prediction is None else 0.25, len(remarks) + 3
    # All end above the foot of the page.
    size = min(8.0, 72 * A4[1] * (top - 0.03) / (1.25 * count))
    figure.text(0.7, top, "\n".join([NOTE, *remarks]), va="top", fontsize=size, color="0.3")
    return figure


def _draw_prediction(axes: Axes, prediction: "Prediction | None") -> None:
    if prediction is None:
        axes.set_axis_off()
        text = "No prediction:\ngive a cube that holds\nthe design."
        axes.text(0, 1, text, va="top", fontsize=9, color="0.3")
        return
    strain, low, high = prediction.applied_strain, prediction.low, prediction.high
    axes.axhline(0, color="0.6", linewidth=0.6)
    if np.isfinite(low).any():
        axes.fill_between(strain, low, high, color="0.8", lw=0, label="slightly different fabrics")
    axes.plot(strain, prediction.poisson_ratio, color="black", label="design")
    axes.set(xlabel=STRAIN_LABEL, ylabel="Poisson's ratio ν [1]")
    axes.set_title(f"predicted for {prediction.sample}\n(cube {prediction.source})", fontsize=8)
    axes.legend()
