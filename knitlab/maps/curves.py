"""Tension curves: ε_xx, ε_yy and ν against applied strain, a column for each n_stripe."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.maps.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.sweep.faults import fault
from knitlab.sweep.registry import Status

ROWS = {
    "mean_strain_xx": "transverse strain\nmean $\\varepsilon_{xx}$ [1]",
    "mean_strain_yy": "axial strain\nmean $\\varepsilon_{yy}$ [1]",
    "poisson_ratio": "Poisson's ratio\n$\\nu$ [1]",
}


def tension_curves(cube: xr.Dataset) -> Figure:
    """The paper's tension figure from a cube (Fig. "tension plots").

    Colour goes with P, the periods in a patch, the same in every column. A test that did not
    reach its last strain ends in a cross.

    Raises:
        BadInput: if no design has been simulated.
    """
    if not cube["status"].isin([Status.ok, Status.not_converged]).any():
        raise fault("curves", "no design of this selection has been simulated; run it first")
    stripes = cube["n_stripe"].values
    figure = Figure(figsize=(TWO_COLUMNS, 4.6), layout="constrained")
    grid = figure.subplots(len(ROWS), len(stripes), sharex=True, sharey="row", squeeze=False)
    periods = np.unique(cube["periods"].values[np.isfinite(cube["periods"].values)])
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.8, len(periods)))
    colours = dict(zip(periods, shades, strict=True))

    for column, n_stripe in enumerate(stripes):
        family = cube.sel(n_stripe=n_stripe)
        run = family["status"].isin([Status.ok, Status.not_converged])
        for n_subunit in family["n_subunit"].values[run.values]:
            design = family.sel(n_subunit=n_subunit)
            colour = colours[float(design["periods"])]
            label = f"{n_subunit} (P = {int(design['periods'])})"
            for axes, name in zip(grid[:, column], ROWS, strict=True):
                curve = design[name].dropna("applied_strain")
                axes.plot(curve["applied_strain"], curve, ".-", ms=3, color=colour, label=label)
                if int(design["status"]) == Status.not_converged and curve.size:
                    axes.plot(curve["applied_strain"][-1], curve[-1], "x", ms=6, color=colour)
        grid[0, column].set_title(f"n_stripe = {n_stripe}")
        # Axial strain follows the diagonal and leaves this corner free.
        if run.any():
            grid[1, column].legend(
                title="n_subunit",
                loc="lower right",
                frameon=False,
                handlelength=1,
                borderpad=0,
                fontsize=5.5,
                title_fontsize=6,
                labelspacing=0.15,
            )
        grid[-1, column].set_xlabel("applied strain [1]")
    for axes, label in zip(grid[:, 0], ROWS.values(), strict=True):
        axes.set_ylabel(label)
    for axes in (*grid[0], *grid[-1]):
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    figure.align_ylabels(list(grid[:, 0]))
    return figure
