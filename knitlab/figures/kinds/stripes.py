"""Tension curves of pure stripes."""

from collections.abc import Iterator, Sequence
from typing import Any

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knitlab.figures.cells import not_run
from knitlab.figures.registry import figure
from knitlab.figures.style import STRAIN_LABEL, Look, shades, subplots
from knitlab.observables.schema import STRAIN, STRIPE_DIMS
from knitlab.observables.status import RUN

SHEETS: dict[str, Look] = {
    "periodic": {"marker": "o", "ms": 2.5, "fillstyle": "full", "ls": ""},
    "clamped": {"marker": "s", "ms": 5, "fillstyle": "none", "ls": ""},
}
"""Marks of the sheets, by their boundary."""


@figure(dims=STRIPE_DIMS, coordinates=(STRAIN,))
def stripes(cube: xr.Dataset) -> Figure:
    """Tension curves of pure stripes: zigzag as lines, sheet as points (paper, Fig. 1D, E)."""
    cube = cube.isel(knit=cube["status"].isin(RUN).any(["n", "boundary"]).values)
    if not cube.sizes["knit"]:
        raise not_run()
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
    looks: dict[str, Look] = {"2D zigzag": {}}
    looks |= {f"3D sheet, {boundary}": look for boundary, look in sheets.items()}
    handles = [Line2D([], [], color="0.3", label=label, **look) for label, look in looks.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def stripe_panels(cube: xr.Dataset) -> tuple[Figure, Sequence[Axes]]:
    """A figure with one panel for each knit of a cube of pure stripes."""
    knits = cube["knit"].values
    figure, (panels,) = subplots(3.2, 1, len(knits), squeeze=False)
    for axes, knit in zip(panels, knits, strict=True):
        axes.set(title=f"$n \\times n$ {knit}", xlabel=STRAIN_LABEL)
    return figure, panels


def coloured_stripes(cube: xr.Dataset, knit: str) -> Iterator[tuple[Any, xr.Dataset]]:
    """The stripes of a knit that have results, each with a colour."""
    family = cube.sel(knit=knit).transpose("n", "boundary", ...)
    family = family.isel(n=family["status"].isin(RUN).any("boundary").values)
    for n, colour in zip(family["n"].values, shades(family.sizes["n"]), strict=True):
        yield colour, family.sel(n=n)
