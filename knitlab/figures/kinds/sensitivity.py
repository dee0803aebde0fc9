"""The sensitivity map: which stripe parameter the Poisson's ratio of each design depends on."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cube.schema import DESIGN_DIMS, Status
from knitlab.figures.cells import MARKS, cell, ink_on, marks_legend, remove_frame
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import STRAIN_COLOURS, TWO_COLUMNS, number
from knitlab.io.errors import fault

QUANTITY = "poisson_ratio_sensitivity"
SYMBOLS = {"k_s": "$k_s$", "k_t": "$k_t$", "theta_0": "$\\theta_0$"}
PERIODS = {"rib": "$w$ (period)", "garter": "$h$ (period)"}
GAP = 0.25
"""Gap between the columns of rib and of garter, in cells."""
MOST_DESIGNS = 60
"""Largest number of rows that remain legible."""
MOST_OVER_MEDIAN = 3
"""Limit of the colour scale over the median of the designs' largest sensitivities."""


def sensitivity_map(cube: xr.Dataset) -> Figure:
    """Which stripe parameter the Poisson's ratio of each design depends on.

    Shows the sensitivity p ∂ν/∂p of every design to every stripe parameter at the strain where its
    ν is lowest. The largest magnitude of a row is framed. Designs without a lowest ν, or without
    derivatives there, are marked by status.

    Raises:
        BadInput: if the cube has no sensitivities, or too many designs for one figure.
    """
    if QUANTITY not in cube:
        raise fault("sensitivity", "needs sensitivities; run with sensitivities = true")
    designs = cube.stack(design=DESIGN_DIMS)
    designs = designs.isel(design=designs["status"].values != Status.excluded)
    labels = [(int(n), int(m)) for n, m in designs["design"].values]
    if len(labels) > MOST_DESIGNS:
        problem = f"shows {MOST_DESIGNS} designs at most, not {len(labels)}; select some"
        raise fault("sensitivity", problem)
    strains = designs["applied_strain_at_min"].values
    parameters = [str(name) for name in cube["stripe_parameter"].values]
    values = np.array([_at_strain(designs.isel(design=k), strains[k]) for k in range(len(labels))])
    values = values.reshape(len(labels), len(parameters))

    norm = _norm(values)
    colours = mpl.colormaps[STRAIN_COLOURS]
    columns = [k + GAP * name.startswith("garter_") for k, name in enumerate(parameters)]
    figure = Figure(figsize=(TWO_COLUMNS, 1.7 + 0.24 * len(labels)), layout="constrained")
    axes = figure.add_subplot()
    marked: set[Status] = set()
    for row, sensitivities in enumerate(values):
        if np.isfinite(sensitivities).all():
            _row(axes, row, columns, sensitivities, norm, colours)
            continue
        code = Status(int(designs["status"][row]))
        marked.add(code)
        for column in columns:
            cell(axes, row, column, **MARKS[code])

    axes.set(
        xlim=(-0.55, columns[-1] + 0.55),
        ylim=(len(labels) - 0.45, -0.55),
        xticks=columns,
        yticks=range(len(labels)),
        xticklabels=[_symbol(name) for name in parameters],
        yticklabels=[_named(*pair) for pair in zip(labels, strains, strict=True)],
        ylabel="design (n_stripe, n_subunit)\nat the strain of its lowest $\\nu$",
    )
    for knit in PERIODS:
        places = [c for c, name in zip(columns, parameters, strict=True) if name.startswith(knit)]
        middle = (places[0] + places[-1]) / 2
        axes.annotate(
            f"{knit} stripe",
            (middle, -0.5),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
        )
    remove_frame(axes)
    figure.colorbar(
        mpl.cm.ScalarMappable(norm, colours),
        ax=axes,
        pad=0.01,
        extend="both" if np.nanmax(np.abs(values), initial=0) > norm.vmax else "neither",
        label="$p\\,\\partial\\nu/\\partial p$ [1]",
    )
    figure.supxlabel(
        "change of Poisson's ratio for a relative change of a number $p$ of a stripe;"
        " framed: the largest in magnitude of a design",
        fontsize="medium",
    )
    marks_legend(figure, marked, no_value="no derivative, or no lowest ratio")
    return figure


def _at_strain(design: xr.Dataset, strain: float) -> np.ndarray:
    """Sensitivities of a design at one strain; missing if the strain is."""
    place = np.flatnonzero(np.isclose(design["applied_strain"].values, strain, 0, 1e-9))
    along = design[QUANTITY].transpose("applied_strain", "stripe_parameter").values
    return along[place[0]] if place.size else np.full(along.shape[1], np.nan)


def _norm(values: np.ndarray) -> mpl.colors.Normalize:
    """Norm symmetric about zero, limited so that one design near a snap does not dominate it."""
    largest = np.abs(values[np.isfinite(values).all(axis=1)]).max(axis=1, initial=0)
    bound = MOST_OVER_MEDIAN * float(np.median(largest)) if largest.size else 1.0
    bound = min(float(largest.max(initial=0)), bound) or 1.0
    return mpl.colors.Normalize(-bound, bound)


def _row(
    axes: Axes,
    row: int,
    columns: list[float],
    values: np.ndarray,
    norm: mpl.colors.Normalize,
    colours: mpl.colors.Colormap,
) -> None:
    leading = int(np.argmax(np.abs(values)))
    for place, (column, value) in enumerate(zip(columns, values, strict=True)):
        colour = colours(norm(value))
        cell(axes, row, column, facecolor=colour, edgecolor="white")
        weight = "bold" if place == leading else "normal"
        text = number(value, "+.2f" if abs(value) < 9.995 else "+.0f")
        axes.text(column, row, text, ha="center", va="center", color=ink_on(colour), weight=weight)
    cell(axes, row, columns[leading], facecolor="none", edgecolor="black", zorder=3)


def _symbol(parameter: str) -> str:
    knit, _, name = parameter.partition("_")
    return PERIODS[knit] if name == "period" else SYMBOLS[name]


def _named(design: tuple[int, int], strain: float) -> str:
    where = f"at {strain:.0%}" if np.isfinite(strain) else ""
    return f"({design[0]}, {design[1]})  {where}"


FIGURE = FigureKind(sensitivity_map)
