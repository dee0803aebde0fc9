"""Pure stripes: tension of the two-dimensional zigzag and of the sheet, and how far they agree."""

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS
from knitlab.io.design_status import Status

SHEETS: dict[str, dict[str, Any]] = {
    "periodic": {"label": "3D sheet, periodic", "marker": "o", "ms": 2.5, "ls": "-"},
    "clamped": {"label": "3D sheet, clamped", "marker": "s", "ms": 5, "ls": "--"},
}
EVERY = 4
"""Strain steps between the points of a sheet, so that the lines stay visible."""
SHOWN = (-7, 30)
"""Largest departure that is drawn [%]."""
AGREEMENT = 0.05
"""Relative difference within which the two models count as equal."""


def stripe_tension(cube: xr.Dataset) -> Figure:
    """The paper's stress–strain families: zigzag as lines, sheet as points (Fig. 1D, E)."""
    figure, panels = _panels(cube)
    boundaries = list(map(str, cube["boundary"].values))
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        for colour, stripe in _stripes(cube, str(knit)):
            zigzag = stripe["zigzag_force"].max("boundary")
            axes.plot(cube["applied_strain"], zigzag, color=colour, label=str(int(stripe["n"])))
            for boundary in boundaries:
                points = stripe["row_force"].sel(boundary=boundary)[::EVERY]
                filling = colour if boundary == "periodic" else "none"
                marker = SHEETS[boundary]["marker"]
                size = SHEETS[boundary]["ms"]
                axes.plot(
                    points["applied_strain"], points, marker, ms=size, mfc=filling, color=colour
                )
        axes.set(ylabel="force for one row [N]", ylim=(0, None))
        axes.legend(title="stripe $n$", loc="upper left", frameon=False)
    handles = [Line2D([], [], color="0.3", label="2D zigzag")]
    for boundary in boundaries:
        filling = "0.3" if boundary == "periodic" else "none"
        look = SHEETS[boundary] | {"ls": ""}
        handles.append(Line2D([], [], color="0.3", mfc=filling, **look))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    return figure


def stripe_departure(cube: xr.Dataset) -> Figure:
    """How far the sheet departs from the zigzag, relative to the zigzag's force.

    The legend says up to which applied strain every sheet stays within 5 %.
    """
    figure, panels = _panels(cube)
    boundaries = list(map(str, cube["boundary"].values))
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        axes.axhspan(-100 * AGREEMENT, 100 * AGREEMENT, color="0.93", lw=0)
        axes.axhline(0, color="0.7", lw=0.6)
        for colour, stripe in _stripes(cube, str(knit)):
            departure = (stripe["row_force"] / stripe["zigzag_force"] - 1)[:, 1:]
            for boundary in boundaries:
                line = 100 * departure.sel(boundary=boundary)
                axes.plot(line["applied_strain"], line, ls=SHEETS[boundary]["ls"], color=colour)
            agreed = _agreed_strain(departure)
            axes.plot([], [], color=colour, label=f"{int(stripe['n'])}, to {agreed:.0%}")
        axes.set(ylabel="force of the sheet over the zigzag's, less 1 [%]", ylim=SHOWN)
        axes.legend(title=f"stripe $n$, within {AGREEMENT:.0%}", loc="upper left", frameon=False)
    handles = [
        Line2D([], [], color="0.3", ls=SHEETS[boundary]["ls"], label=SHEETS[boundary]["label"])
        for boundary in boundaries
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    return figure


def _panels(cube: xr.Dataset) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(TWO_COLUMNS, 3.2), layout="constrained")
    knits = cube["knit"].values
    panels = figure.subplots(1, len(knits), squeeze=False)[0]
    for axes, knit in zip(panels, knits, strict=True):
        axes.set(title=f"$n \\times n$ {knit}", xlabel="applied strain [1]")
    return figure, panels


def _stripes(cube: xr.Dataset, knit: str) -> Iterator[tuple[Any, xr.Dataset]]:
    """Every stripe of a knit that has results, with its colour."""
    family = cube.sel(knit=knit).transpose("n", "boundary", ...)
    run = family["status"].isin([Status.ok, Status.not_converged]).values.any(axis=1)
    sizes = family["n"].values[run]
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.8, max(len(sizes), 1)))
    for n, colour in zip(sizes, shades, strict=False):
        yield colour, family.sel(n=n)


def _agreed_strain(departure: xr.DataArray) -> float:
    """Largest applied strain up to which no sheet departs by more than :data:`AGREEMENT`."""
    beyond = abs(departure).max("boundary").values > AGREEMENT
    strains = departure["applied_strain"].values
    within = int(np.argmax(beyond)) if beyond.any() else len(strains)
    return float(strains[within - 1]) if within else 0.0
