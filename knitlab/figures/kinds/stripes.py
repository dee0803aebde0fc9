"""Pure stripes: tension of the two-dimensional zigzag and of the sheet."""

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knitlab.cube.schema import STRIPE_DIMS, Status
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import SEQUENCE_COLOURS, TWO_COLUMNS

SHEETS: dict[str, dict[str, Any]] = {
    "periodic": {"label": "3D sheet, periodic", "marker": "o", "ms": 2.5, "ls": "-"},
    "clamped": {"label": "3D sheet, clamped", "marker": "s", "ms": 5, "ls": "--"},
}
EVERY = 4
"""Strain steps between the points of a sheet, so that the lines stay visible."""


def stripe_tension(cube: xr.Dataset) -> Figure:
    """Tension curves of pure stripes: zigzag as lines, sheet as points (paper, Fig. 1D, E)."""
    figure, panels = stripe_panels(cube)
    boundaries = list(map(str, cube["boundary"].values))
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        for colour, stripe in coloured_stripes(cube, str(knit)):
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
        style = SHEETS[boundary] | {"ls": ""}
        handles.append(Line2D([], [], color="0.3", mfc=filling, **style))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    return figure


def stripe_panels(cube: xr.Dataset) -> tuple[Figure, Sequence[Axes]]:
    """A figure with one panel for each knit of a cube of pure stripes."""
    figure = Figure(figsize=(TWO_COLUMNS, 3.2), layout="constrained")
    knits = cube["knit"].values
    panels = figure.subplots(1, len(knits), squeeze=False)[0]
    for axes, knit in zip(panels, knits, strict=True):
        axes.set(title=f"$n \\times n$ {knit}", xlabel="applied strain [1]")
    return figure, panels


def coloured_stripes(cube: xr.Dataset, knit: str) -> Iterator[tuple[Any, xr.Dataset]]:
    """The stripes of a knit that have results, each with a colour."""
    family = cube.sel(knit=knit).transpose("n", "boundary", ...)
    run = family["status"].isin([Status.ok, Status.not_converged]).values.any(axis=1)
    sizes = family["n"].values[run]
    shades = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 0.8, max(len(sizes), 1)))
    for n, colour in zip(sizes, shades, strict=False):
        yield colour, family.sel(n=n)


FIGURE = FigureKind(stripe_tension, STRIPE_DIMS, coordinates=("applied_strain",))
