"""The paper's claims under each set of model options, the best set first."""

from collections.abc import Sequence
from pathlib import Path

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.figures.cells import cell
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import MINUS, TWO_COLUMNS
from knitlab.io.errors import fault
from knitlab.validation.claims import TOPICS, Claim, read_claims
from knitlab.validation.margin import Grade, signed
from knitlab.validation.option_ranking import RankedOptions, differing, ranked_options

MOST = 16
"""Largest number of sets of options that the figure shows."""
LOOKS = {
    Grade.holds: ("#0072B2", "white"),
    Grade.near_miss: ("#F5D7A1", "black"),
    Grade.fails: ("#E69F00", "black"),
    Grade.not_measured: ("white", "black"),
}
NAMES = {
    Grade.holds: "holds",
    Grade.near_miss: "near miss",
    Grade.fails: "fails",
    Grade.not_measured: "not measured",
}
NOTE = "numbers are margins: 0 and above holds, −0.25 misses a limit by a quarter of it"


def readings_figure(cubes: Sequence[tuple[Path, xr.Dataset]]) -> Figure:
    """Which of the paper's claims each set of model options meets, the best set first.

    Claims are rows, sets of options are columns, and each cell gives the margin of a claim. Sets
    are ranked by :func:`.ranked_options`; the best :data:`MOST` are
    shown.

    Args:
        cubes: paths and cubes.

    Raises:
        BadInput: if the cubes decide no claim.
    """
    claims = sorted(read_claims(), key=lambda claim: TOPICS.index(claim.statement.topic))
    ranked = ranked_options(cubes, claims)
    shown = ranked[:MOST]
    claims = [
        claim
        for claim in claims
        if any(it.findings[claim.name].grade is not Grade.not_measured for it in shown)
    ]
    if not claims:
        raise fault("readings", "no claim can be judged by these cubes; run more of their designs")
    names = differing(ranked)
    width = max(TWO_COLUMNS, 3.0 + 0.38 * len(shown))
    figure = Figure(
        figsize=(width, 1.6 + 0.18 * len(claims) + 0.13 * len(names)), layout="constrained"
    )
    axes = figure.add_subplot()
    for column, options in enumerate(shown):
        for row, claim in enumerate(claims):
            _draw(axes, row, column, options, claim)
    axes.set(
        xlim=(-0.5, len(shown) - 0.5),
        ylim=(len(claims) - 0.5, -0.5),
        xticks=range(len(shown)),
        yticks=range(len(claims)),
    )
    axes.set_xticklabels(
        ["\n".join(_head(options, names)) for options in shown], fontsize=5.5, linespacing=1.1
    )
    axes.set_yticklabels([claim.name.replace("_", " ") for claim in claims], fontsize=6.5)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_xlabel(NOTE, fontsize=6)
    if names:
        title = f"from above: {', '.join(names)}; last, claims that hold of those measured"
        axes.set_title(title, fontsize=6)
    if len(ranked) > len(shown):
        figure.suptitle(f"the best {len(shown)} of {len(ranked)} sets of model options", fontsize=7)
    handles = [
        Patch(facecolor=LOOKS[grade][0], edgecolor="0.7", label=label)
        for grade, label in NAMES.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw(axes: Axes, row: int, column: int, options: RankedOptions, claim: Claim) -> None:
    finding = options.findings[claim.name]
    colour, ink = LOOKS[finding.grade]
    edge = "0.85" if finding.grade is Grade.not_measured else "white"
    cell(axes, row, column, facecolor=colour, edgecolor=edge, linewidth=0.8)
    margin = signed(finding.margin).replace("-", MINUS)
    axes.text(column, row, margin, ha="center", va="center", color=ink, fontsize=5.5)


UNSTATED = {"drag": 0}
"""Labels of options that are stated only if they have an effect."""


def _head(options: RankedOptions, names: Sequence[str]) -> list[str]:
    labels = [_short(options.options.get(name, UNSTATED.get(name, ""))) for name in names]
    judged = [f"{options.designs} designs"] if options.designs else []
    return [*labels, *judged, f"{options.count(Grade.holds)}/{options.decided}"]


def _short(label: str | float) -> str:
    return str(label).replace("stripe_", "").replace("per_", "").replace("_", " ")


FIGURE = FigureKind(readings_figure, dims=None, several="any")
