"""Fits of the stripes: to the tension curve of a stripe, and to a test of a fabric."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.figures.kinds.curves import ROWS
from knitlab.figures.kinds.sensitivity import SYMBOLS
from knitlab.figures.style import CATEGORY_COLOURS, ONE_COLUMN, STRAIN_LABEL, TWO_COLUMNS, name_rows

if TYPE_CHECKING:  # which import JAX
    from knitlab.lab.calibration import Calibration
    from knitlab.lab.fit import Fit
    from knitlab.lab.swatch import Swatch

LABELS = (ROWS["mean_strain_xx"].label, ROWS["mean_strain_yy"].label, "reaction force [N]")
FITTED, LINEAR = CATEGORY_COLOURS[:2]
BEFORE, SHADE = "0.55", "0.9"


def calibration_figure(
    fitted: "Calibration",
    title: str,
    linear: "Calibration | None" = None,
    swatches: Sequence["Swatch"] = (),
) -> Figure:
    """Curve, fit and residuals, across the ridges and along them; linear springs, and swatches."""
    panels = 1 if fitted.along is None else 2
    figure = Figure(figsize=(ONE_COLUMN * (1.2 if panels == 1 else 2), 3.6), layout="constrained")
    axes = figure.subplots(2, panels, sharex="col", height_ratios=(3, 1), squeeze=False)
    above, below = axes[:, 0]
    label = "measured" if fitted.repeats == 1 else f"mean of {fitted.repeats} repeats"
    if linear is not None:
        above.plot(fitted.strain, linear.fitted_force, "--", color=LINEAR, label="linear springs")
        below.plot(fitted.strain, 1000 * linear.residuals, "x", ms=2.5, color=LINEAR)
    curves = {"across": (fitted.strain, fitted.force, fitted.fitted_force)}
    if fitted.along is not None:
        along = fitted.along
        curves["along"] = along.strain, along.force, along.fitted_force
    for column, (direction, (strain, measured, found)) in enumerate(curves.items()):
        above, below = axes[:, column]
        above.plot(strain, measured, "o", ms=2.5, mfc="none", color="0.3", label=label)
        above.plot(strain, found, color=FITTED, label="fitted")
        for swatch in swatches:
            if swatch.direction == direction:
                above.plot(swatch.strain, swatch.simulated, "+", ms=6, color="k", label="simulated")
        above.set_title(f"{title}, {direction} the ridges" if panels > 1 else title, fontsize=7)
        below.axhline(0, color="0.7", lw=0.6)
        below.plot(strain, 1000 * (measured - found), ".", ms=3, color=FITTED)
        below.set(xlabel=STRAIN_LABEL)
    axes[0, 0].legend()
    axes[0, 0].set(ylabel="force over width [N/mm]" if fitted.per_width else "force on one row [N]")
    axes[1, 0].set(ylabel=f"residual [m{fitted.force_unit}]")
    figure.align_ylabels(axes[:, 0])
    return figure


def fit_figure(fit: "Fit", title: str) -> Figure:
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
        above.tick_params(bottom=False, labelbottom=False)
        below.axhspan(-1, 1, color=SHADE, lw=0)
        for curves, colour in ((before, BEFORE), (after, FITTED)):
            below.plot(strain, (curves[column] - values) / errors, ".", ms=3, color=colour)
        below.set_yscale("symlog", linthresh=3)
        below.set_yticks((-10, 0, 10), ("−10", "0", "10"))
        below.minorticks_off()
        below.set_xlabel(STRAIN_LABEL)
        if column == 0:
            below.set_ylabel("difference\nover error [1]")
            handles = above.get_legend_handles_labels()[0]
    factors, names = figure.add_subplot(grid[:, 3]), list(fit.factors)
    for row, name in enumerate(names):
        factor, reach = fit.factors[name], np.exp(2 * fit.standard_errors[name])
        factors.plot([factor / reach, factor * reach], [row, row], color=FITTED, lw=1.5)
        factors.plot(factor, row, "o", color=FITTED, ms=4)
    factors.axvline(1, color=BEFORE, lw=0.8)
    knits = [name.partition("_") for name in names]
    name_rows(factors, [f"{knit} {SYMBOLS.get(number, number)}" for knit, _, number in knits])
    factors.set_xlabel("fitted / table [1]\n± 2 standard\nerrors")
    handles.append(Patch(color=SHADE, label="difference within one error"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    figure.suptitle(title, fontsize=8)
    return figure
