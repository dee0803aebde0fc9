"""Pure stripes: tension of the zigzag and of the sheet, and how far they depart."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from knitlab.cube.schema import RUN, STRIPE_DIMS
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import TWO_COLUMNS, shades

SHEETS: dict[str, dict[str, Any]] = {
    "periodic": {"marker": "o", "ms": 2.5, "fillstyle": "full", "ls": ""},
    "clamped": {"marker": "s", "ms": 5, "fillstyle": "none", "ls": ""},
}
"""Marks of the sheets, by their boundary."""


def stripe_tension(cube: xr.Dataset) -> Figure:
    """Tension curves of pure stripes: zigzag as lines, sheet as points (paper, Fig. 1D, E)."""
    figure, panels = stripe_panels(cube)
    sheets = {boundary: SHEETS[boundary] for boundary in cube["boundary"].values}
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        for colour, stripe in coloured_stripes(cube, knit):
            zigzag = stripe["zigzag_force"].max("boundary")
            axes.plot(cube["applied_strain"], zigzag, color=colour, label=str(int(stripe["n"])))
            for boundary, look in sheets.items():
                points = stripe["row_force"].sel(boundary=boundary)[::4]
                axes.plot(points["applied_strain"], points, color=colour, **look)
        axes.set(ylabel="force for one row [N]", ylim=(0, None))
        axes.legend(title="stripe $n$", loc="upper left")
    handles = [
        Line2D([], [], color="0.3", label="2D zigzag"),
        *(
            Line2D([], [], color="0.3", label=f"3D sheet, {boundary}", **look)
            for boundary, look in sheets.items()
        ),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
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
    family = family.isel(n=family["status"].isin(RUN).any("boundary").values)
    for n, colour in zip(family["n"].values, shades(family.sizes["n"]), strict=True):
        yield colour, family.sel(n=n)


LINES = {"periodic": "-", "clamped": "--"}
AGREEMENT = 0.05
"""Relative difference within which the two models count as equal."""


def stripe_departure(cube: xr.Dataset) -> Figure:
    """How far the sheet of a pure stripe departs from its zigzag.

    Shows the difference in force relative to that of the zigzag; the legend states up to which
    applied strain every sheet stays within 5 %.
    """
    figure, panels = stripe_panels(cube)
    lines = {boundary: LINES[boundary] for boundary in cube["boundary"].values}
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        axes.axhspan(-100 * AGREEMENT, 100 * AGREEMENT, color="0.93", lw=0)
        axes.axhline(0, color="0.7", lw=0.6)
        for colour, stripe in coloured_stripes(cube, knit):
            departure = (stripe["row_force"] / stripe["zigzag_force"] - 1)[:, 1:]
            for boundary, line in lines.items():
                curve = 100 * departure.sel(boundary=boundary)
                axes.plot(curve["applied_strain"], curve, ls=line, color=colour)
            label = f"{int(stripe['n'])}: {_agreed_strain(departure):.0%}"
            axes.plot([], [], color=colour, label=label)
        axes.set(ylabel="force beyond the zigzag's [%]", ylim=(-7, 30))
        # The curves fill the panel.
        axes.legend(
            title=f"stripe $n$,\nwithin {AGREEMENT:.0%}\nto a strain of",
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            handlelength=1.5,
            title_fontsize="small",
        )
    handles: list[Artist] = [
        Line2D([], [], color="0.3", ls=line, label=f"3D sheet, {boundary}")
        for boundary, line in lines.items()
    ]
    handles.append(Patch(color="0.93", label=f"within {AGREEMENT:.0%}"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def _agreed_strain(departure: xr.DataArray) -> float:
    """Largest applied strain up to which no sheet departs by more than :data:`AGREEMENT`."""
    beyond = abs(departure).max("boundary").values > AGREEMENT
    strains = departure["applied_strain"].values
    within = int(np.argmax(beyond)) if beyond.any() else len(strains)
    return float(strains[within - 1]) if within else 0.0


FIGURES = {
    "stripes": FigureKind(stripe_tension, STRIPE_DIMS, coordinates=("applied_strain",)),
    "departure": FigureKind(stripe_departure, STRIPE_DIMS, coordinates=("applied_strain",)),
}
