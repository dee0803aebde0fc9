"""The calibration: measured curve, fitted zigzag and residual."""

import numpy as np
from matplotlib.figure import Figure

from knitlab.figures.style import CATEGORY_COLOURS, ONE_COLUMN

FITTED, LINEAR = CATEGORY_COLOURS[:2]


def calibration_figure(
    strain: np.ndarray,
    force: np.ndarray,
    fitted_force: np.ndarray,
    title: str,
    linear_force: np.ndarray | None = None,
) -> Figure:
    """Curve and fit above, residual of each fit below in its colour.

    Args:
        strain: applied strain [1].
        force: measured, on one row [N].
        fitted_force: of the fitted zigzag [N].
        title: what was fitted; one line or more.
        linear_force: force of the zigzag of linear springs, if the fit has another law [N].
    """
    figure = Figure(figsize=(ONE_COLUMN * 1.2, 3.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot(strain, force, "o", ms=2.5, mfc="none", color="0.3", label="measured")
    if linear_force is not None:
        above.plot(strain, linear_force, color=LINEAR, ls="--", label="with linear springs")
        below.plot(strain, 1000 * (force - linear_force), "x", ms=2.5, color=LINEAR)
    above.plot(strain, fitted_force, color=FITTED, label="zigzag, fitted")
    above.set(ylabel="force for one row [N]")
    above.set_title(title, fontsize=7)
    above.legend(frameon=False)
    below.axhline(0, color="0.7", lw=0.6)
    below.plot(strain, 1000 * (force - fitted_force), ".", ms=3, color=FITTED)
    below.set(xlabel="applied strain [1]", ylabel="residual [mN]")
    figure.align_ylabels([above, below])
    return figure
