"""The specification sheet of a sample: one page for the knitter."""

import textwrap
from datetime import date
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.figures.stitch_chart import draw_chart, drawn_part, legend_handles, title_of

if TYPE_CHECKING:
    from knitlab.knitting.specification import Prediction, Specification

A4 = 210 / 25.4, 297 / 25.4
"""Width and height of the page [in]."""
CHART_WIDTH = 4.4
"""Width of the chart on the page [in]."""
LINE = 0.0165
"""Height of a line of the table, as a part of the page."""
WIDEST_VALUE = 78
"""Letters of a value on one line."""


def specification_sheet(specification: "Specification") -> Figure:
    """One page A4: what a sample takes to knit, its chart, and what is predicted of it.

    Args:
        specification: the specification.
    """
    figure = Figure(figsize=A4)
    figure.text(0.07, 0.955, "Specification of a knitted sample", fontsize=14, weight="bold")
    written = f"knitlab {version('knitlab')}, {date.today().isoformat()}"
    figure.text(0.93, 0.955, written, ha="right", fontsize=8, color="0.3")
    _draw_rows(figure, specification)
    chart = specification.chart
    _, columns = drawn_part(chart)
    axes = figure.add_axes((0.1, 0.12, 0.54, 0.4))
    axes.set_anchor("NW")
    draw_chart(axes, chart, CHART_WIDTH / (columns.stop - columns.start))
    figure.text(0.07, 0.565, f"Chart, seen from the front. {title_of(chart)}", fontsize=9)
    figure.legend(
        handles=legend_handles(chart),
        loc="lower left",
        bbox_to_anchor=(0.06, 0.03),
        ncols=2,
        frameon=False,
    )
    beside = figure.add_axes((0.75, 0.32, 0.2, 0.18))
    if specification.prediction is None:
        _say_nothing_predicted(beside)
    else:
        _draw_prediction(beside, specification.prediction)
    _draw_notes(figure, specification)
    return figure


def _draw_rows(figure: Figure, specification: "Specification") -> None:
    place = 0.925
    for name, value in specification.rows():
        lines = textwrap.wrap(value, WIDEST_VALUE) or [""]
        figure.text(0.07, place, name, fontsize=9, color="0.3", va="top")
        figure.text(0.24, place, "\n".join(lines), fontsize=9, va="top")
        place -= LINE * len(lines)


def _draw_prediction(axes: Axes, prediction: "Prediction") -> None:
    strain = prediction.applied_strain
    axes.axhline(0, color="0.6", linewidth=0.6)
    if np.isfinite(prediction.low).any():
        axes.fill_between(
            strain,
            prediction.low,
            prediction.high,
            color="0.8",
            linewidth=0,
            label="slightly different fabrics",
        )
    axes.plot(strain, prediction.poisson_ratio, color="black", label="design")
    axes.set(xlabel="applied strain [1]", ylabel="Poisson's ratio ν [1]")
    axes.set_title(f"predicted for {prediction.sample}\n(cube {prediction.source})", fontsize=8)
    axes.legend(frameon=False)


def _say_nothing_predicted(axes: Axes) -> None:
    axes.set_axis_off()
    text = "No prediction:\ngive a cube that holds\nthe design."
    axes.text(0, 1, text, va="top", fontsize=9, color="0.3")


def _draw_notes(figure: Figure, specification: "Specification") -> None:
    notes = [
        "Sizes are of cloth, by the gauge;",
        "times by the speeds in machine.toml.",
        "Both are estimates.",
        *(line for remark in specification.remarks for line in textwrap.wrap(remark, 34)),
    ]
    figure.text(0.7, 0.25, "\n".join(notes), va="top", fontsize=8, color="0.3")
