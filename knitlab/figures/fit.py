"""The fit to a whole fabric: measured curves, and those simulated before and after."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.figures.style import CATEGORY_COLOURS, TWO_COLUMNS

LABELS = (
    "transverse strain\nmean $\\varepsilon_{xx}$ [1]",
    "axial strain\nmean $\\varepsilon_{yy}$ [1]",
    "reaction force [N]",
)
BEFORE, AFTER, SHADE = "0.55", CATEGORY_COLOURS[0], "0.9"


class Fitted(NamedTuple):
    """Curves and factors of a fit.

    Attributes:
        applied_strain: above 0 [1].
        measured: mean transverse and axial strain, and reaction force, (quantity, strain).
        errors: standard errors of these, (quantity, strain).
        before: simulated with the tabulated stripes, (quantity, strain).
        after: simulated with the fitted stripes, (quantity, strain).
        factors: fitted over tabulated value, by parameter.
        standard_errors: standard errors of the logarithms of the factors.
    """

    applied_strain: Sequence[float]
    measured: np.ndarray
    errors: np.ndarray
    before: np.ndarray
    after: np.ndarray
    factors: dict[str, float]
    standard_errors: dict[str, float]


def fit_figure(shown: Fitted, title: str) -> Figure:
    """Curves above, residuals in standard errors below, and the factors beside them.

    Args:
        shown: the fit.
        title: title of the figure.
    """
    figure = Figure(figsize=(TWO_COLUMNS, 3.6), layout="constrained")
    grid = figure.subplots(2, 4, height_ratios=(2.5, 1), width_ratios=(1, 1, 1, 0.9))
    strain = np.asarray(shown.applied_strain)
    for column, label in enumerate(LABELS):
        above, below = grid[:, column]
        values, errors = shown.measured[column], shown.errors[column]
        above.plot(strain, shown.before[column], color=BEFORE, label="simulated, tables")
        above.plot(strain, shown.after[column], color=AFTER, label="simulated, fitted")
        above.plot(strain, values, "--", color="black", label="measured")
        above.set(ylabel=label)
        above.tick_params(labelbottom=False)
        below.axhspan(-1, 1, color=SHADE, lw=0)
        for curves, colour in ((shown.before, BEFORE), (shown.after, AFTER)):
            below.plot(strain, (curves[column] - values) / errors, ".", ms=3, color=colour)
        below.set_yscale("symlog", linthresh=3)
        below.set_xlabel("applied strain [1]")
    grid[1, 0].set_ylabel("difference\nover error [1]")
    _draw_factors(figure, grid[:, 3], shown)
    handles = [
        *grid[0, 0].get_legend_handles_labels()[0],
        Patch(color=SHADE, label="difference within one error"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle(title, fontsize=8)
    return figure


def _draw_factors(figure: Figure, column: np.ndarray, shown: Fitted) -> None:
    """Factors with two standard errors."""
    spec = column[0].get_gridspec()
    for axes in column:
        axes.remove()
    axes = figure.add_subplot(spec[:, 3])
    names = list(shown.factors)
    for place, name in enumerate(names):
        factor, reach = shown.factors[name], np.exp(2 * shown.standard_errors[name])
        axes.plot([factor / reach, factor * reach], [place, place], color=AFTER, lw=1.5)
        axes.plot(factor, place, "o", color=AFTER, ms=4)
    axes.axvline(1, color=BEFORE, lw=0.8)
    axes.set(
        yticks=range(len(names)),
        yticklabels=names,
        xlabel="fitted / table [1]\n± 2 standard errors",
    )
    axes.set_ylim(len(names) - 0.5, -0.5)
