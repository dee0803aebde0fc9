"""The paper's claims under each set of model options, the best set first."""

from collections.abc import Sequence
from textwrap import fill

import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.claims.claims import TOPICS, read_claims
from knitlab.claims.margin import Grade, signed
from knitlab.claims.option_ranking import RankedOptions, differing, ranked_options
from knitlab.figures.cells import cell, remove_frame
from knitlab.figures.registry import figure
from knitlab.figures.style import MINUS, TWO_COLUMNS, Look, name_rows, subplots
from knitlab.io.errors import invalid

MAX_SETS = 16  # largest number of sets of options that the figure shows
COLOURS = {
    Grade.holds: "#0072B2",
    Grade.near_miss: "#F5D7A1",
    Grade.fails: "#E69F00",
    Grade.not_measured: "white",
}
NOTE = "numbers are margins: 0 and above holds, −0.25 misses a limit by a quarter of it"
WIDTH_OF_CLAIM = 56  # letters
UNSTATED = {"drag": 0}  # labels of options that are stated only if they have an effect


@figure(dims=None, several="any", compares=True)
def options(cubes: Sequence[xr.Dataset]) -> Figure:
    """Which of the paper's claims each set of model options meets, the best set first."""
    claims = sorted(read_claims(), key=lambda claim: TOPICS.index(claim.topic))
    ranked = ranked_options(cubes, claims)
    shown = ranked[:MAX_SETS]
    claims = [
        claim
        for claim in claims
        if any(options.results[claim.name].margin is not None for options in shown)
    ]
    if not claims:
        raise invalid("options", "no claim can be judged by these cubes; run more of their designs")
    varied = differing(ranked)
    width = max(TWO_COLUMNS, 3.0 + 0.38 * len(shown))
    figure, axes = subplots(1.6 + 0.25 * len(claims) + 0.13 * len(varied), width=width)
    for column, options in enumerate(shown):
        for row, claim in enumerate(claims):
            result = options.results[claim.name]
            look: Look = {"facecolor": COLOURS[result.grade], "linewidth": 0.8}
            look["edgecolor"] = "0.85" if result.margin is None else "white"
            margin = signed(result.margin).replace("-", MINUS)
            cell(axes, row, column, margin, letters={"fontsize": 6.5}, **look)
    axes.set_xlim(-0.5, len(shown) - 0.5)
    heads = [_head(options, varied) for options in shown]
    axes.set_xticks(range(len(shown)), heads, fontsize=6.5, linespacing=1.1)
    name_rows(axes, [fill(claim.quoted, WIDTH_OF_CLAIM) for claim in claims], fontsize=6.5)
    axes.xaxis.tick_top()
    remove_frame(axes)
    axes.set_xlabel(NOTE, fontsize=6.5)
    if varied:
        names = ", ".join(name.replace("_", " ") for name in varied)
        title = f"from above: {names}; last, claims that hold of those measured"
        axes.set_title(title, fontsize=6.5)
    if len(ranked) > len(shown):
        figure.suptitle(f"the best {len(shown)} of {len(ranked)} sets of model options", fontsize=7)
    handles = [
        Patch(facecolor=colour, edgecolor="0.7", label=grade.value)
        for grade, colour in COLOURS.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _head(options: RankedOptions, varied: Sequence[str]) -> str:
    lines = [str(options.options.get(name, UNSTATED.get(name, ""))) for name in varied]
    lines = [each.replace("stripe_", "").replace("per_", "").replace("_", " ") for each in lines]
    lines += [f"{options.designs} designs"] if options.designs else []
    return "\n".join([*lines, f"{options.count(Grade.holds)}/{options.decided}"])
