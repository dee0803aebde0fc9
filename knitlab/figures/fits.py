"""Fits of the stripes: to the tension curve of a stripe, and to a test of a fabric."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.figures.kinds.curves import ROWS
from knitlab.figures.style import CATEGORY_COLOURS, ONE_COLUMN, TWO_COLUMNS, name_rows
from knitlab.laboratory.fit import Fit
from knitlab.measure.calibration import Calibration

LABELS = (ROWS["mean_strain_xx"], ROWS["mean_strain_yy"], "reaction force [N]")
FITTED, LINEAR = CATEGORY_COLOURS[:2]
BEFORE, SHADE = "0.55", "0.9"


def calibration_figure(
    fitted: Calibration, title: str, linear: Calibration | None = None
) -> Figure:
    """Curve and fit above, residuals below; also those of linear springs if they are not fitted."""
    figure = Figure(figsize=(ONE_COLUMN * 1.2, 3.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    strain = fitted.strain
    label = "measured" if fitted.repeats == 1 else f"mean of {fitted.repeats} repeats"
    above.plot(strain, fitted.force, "o", ms=2.5, mfc="none", color="0.3", label=label)
    if linear is not None:
        label = "with linear springs"
        above.plot(strain, linear.fitted_force, color=LINEAR, ls="--", label=label)
        below.plot(strain, 1000 * linear.residuals, "x", ms=2.5, color=LINEAR)
    above.plot(strain, fitted.fitted_force, color=FITTED, label="zigzag, fitted")
    load = "force over width [N/mm]" if fitted.per_width else "force on one row [N]"
    above.set(ylabel=load)
    above.set_title(title, fontsize=7)
    above.legend()
    below.axhline(0, color="0.7", lw=0.6)
    below.plot(strain, 1000 * fitted.residuals, ".", ms=3, color=FITTED)
    below.set(xlabel="applied strain [1]", ylabel=f"residual [m{fitted.force_unit}]")
    figure.align_ylabels([above, below])
    return figure


def fit_figure(fit: Fit, title: str) -> Figure:
    """Curves above, residuals in standard errors below, and the factors beside them."""
    figure = Figure(figsize=(TWO_COLUMNS, 3.6), layout="constrained")
    grid = figure.add_gridspec(2, 4, height_ratios=(2.5, 1), width_ratios=(1, 1, 1, 0.9))
    strain, (before, after) = np.asarray(fit.target.applied_strain), fit.curves
    for column, label in enumerate(LABELS):
        above, below = (figure.add_subplot(grid[row, column]) for row in (0, 1))
        values, errors = fit.target.values[column], fit.target.errors[column]
        above.plot(strain, before[column], color=BEFORE, label="simulated, tables")
        above.plot(strain, after[column], color=FITTED, label="simulated, fitted")
        above.plot(strain, values, "--", color="black", label="measured")
        above.set(ylabel=label)
        above.tick_params(labelbottom=False)
        below.axhspan(-1, 1, color=SHADE, lw=0)
        for curves, colour in ((before, BEFORE), (after, FITTED)):
            below.plot(strain, (curves[column] - values) / errors, ".", ms=3, color=colour)
        below.set_yscale("symlog", linthresh=3)
        below.set_yticks((-10, 0, 10), ("−10", "0", "10"))
        below.set_xlabel("applied strain [1]")
        if column == 0:
            below.set_ylabel("difference\nover error [1]")
            handles = above.get_legend_handles_labels()[0]
    factors, names = figure.add_subplot(grid[:, 3]), list(fit.factors)
    for row, name in enumerate(names):
        factor, reach = fit.factors[name], np.exp(2 * fit.standard_errors[name])
        factors.plot([factor / reach, factor * reach], [row, row], color=FITTED, lw=1.5)
        factors.plot(factor, row, "o", color=FITTED, ms=4)
    factors.axvline(1, color=BEFORE, lw=0.8)
    name_rows(factors, names)
    factors.set_xlabel("fitted / table [1]\n± 2 standard\nerrors")
    handles.append(Patch(color=SHADE, label="difference within one error"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    figure.suptitle(title, fontsize=8)
    return figure
