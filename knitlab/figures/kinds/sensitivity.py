"""The sensitivity map: which stripe parameter the Poisson's ratio of each design depends on."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures import cells
from knitlab.figures.registry import figure
from knitlab.figures.style import Look, colour_bar, number, subplots, value_colours
from knitlab.io.errors import invalid
from knitlab.observables.status import Status

QUANTITY = "poisson_ratio_sensitivity"
SYMBOLS = {"k_s": "$k_s$", "k_t": "$k_t$", "theta_0": "$\\theta_0$"}
PERIODS = {"rib": "$w$ (period)", "garter": "$h$ (period)"}
MAX_DESIGNS = 60  # largest number of rows that remain legible
MAX_OVER_MEDIAN = 3  # limit of the colour scale over the median of the largest sensitivities
NOTE = (
    "change of Poisson's ratio for a relative change of a number $p$ of a stripe;"
    " framed: the largest in magnitude of a design"
)


@figure()
def sensitivity(cube: xr.Dataset) -> Figure:
    """Which stripe parameter the Poisson's ratio of each design depends on.

    Shows the sensitivity p ∂ν/∂p of every design to every stripe parameter at the strain where its
    ν is lowest; the largest magnitude of a row is framed.
    """
    if QUANTITY not in cube:
        raise invalid("sensitivity", "needs sensitivities; run with sensitivities = true")
    designs = cells.planned_designs(cube)
    if len(designs) > MAX_DESIGNS:
        message = f"shows {MAX_DESIGNS} designs at most, not {len(designs)}; select some"
        raise invalid("sensitivity", message)
    parameters = [str(name) for name in cube["stripe_parameter"].values]
    columns = [k + 0.25 * name.startswith("garter_") for k, name in enumerate(parameters)]
    values = np.array([_at_lowest(design) for design in designs]).reshape(-1, len(parameters))
    largest = np.abs(values[np.isfinite(values).all(axis=1)]).max(axis=1, initial=0)
    bound = float(largest.max(initial=0))
    if largest.size:
        # One design near a snap would dominate the colours of all.
        bound = min(bound, MAX_OVER_MEDIAN * float(np.median(largest)))
    bound = bound or 1.0
    colours = value_colours(np.array([-bound, bound]))
    rgba = colours.to_rgba(values)
    figure, axes = subplots(1.7 + 0.24 * len(designs))
    marked: set[Status] = set()
    for row, (design, sensitivities) in enumerate(zip(designs, values, strict=True)):
        if not np.isfinite(sensitivities).all():
            status = Status(int(design["status"]))
            marked.add(status)
            for column in columns:
                cells.cell(axes, row, column, **cells.MARKS[status])
            continue
        leading = int(np.argmax(np.abs(sensitivities)))
        for k, (column, value) in enumerate(zip(columns, sensitivities, strict=True)):
            text = number(value, "+.2f" if abs(value) < 9.995 else "+.0f")
            letters: Look = {"weight": "bold" if k == leading else "normal"}
            cells.cell(axes, row, column, text, letters=letters, facecolor=rgba[row, k])
        frame: Look = {"facecolor": "none", "edgecolor": "black", "zorder": 3}
        cells.cell(axes, row, columns[leading], **frame)
    parts = [name.partition("_") for name in parameters]
    axes.set_xticks(columns, [SYMBOLS.get(name, PERIODS[knit]) for knit, _, name in parts])
    strains = [float(design["applied_strain_at_min"]) for design in designs]
    wheres = [f"at {strain:.0%}" if np.isfinite(strain) else "" for strain in strains]
    names = [f"{cells.design_name(each)}  {at}" for each, at in zip(designs, wheres, strict=True)]
    axes.set_yticks(range(len(designs)), names)
    axes.set(xlim=(-0.55, columns[-1] + 0.55), ylim=(len(designs) - 0.45, -0.55))
    axes.set_ylabel("design (n_stripe, n_subunit)\nat the strain of its lowest $\\nu$")
    for knit in PERIODS:
        own = [c for c, name in zip(columns, parameters, strict=True) if name.startswith(knit)]
        above: Look = {"xytext": (0, 4), "textcoords": "offset points", "ha": "center"}
        axes.annotate(f"{knit} stripe", ((own[0] + own[-1]) / 2, -0.5), **above)
    cells.remove_frame(axes)
    extend = "both" if np.nanmax(np.abs(values), initial=0) > bound else "neither"
    if largest.size:
        label = "$p\\,\\partial\\nu/\\partial p$ [1]"
        colour_bar(axes, colours, pad=0.01, extend=extend, label=label)
    cells.marks_legend(figure, marked, "no derivative, or no lowest ratio", [NOTE])
    return figure


def _at_lowest(design: xr.Dataset) -> np.ndarray:
    """Sensitivities of a design where its ν is lowest; missing if that strain is not recorded."""
    strains, lowest = design["applied_strain"].values, float(design["applied_strain_at_min"])
    along = design[QUANTITY].transpose("applied_strain", "stripe_parameter").values
    at = np.flatnonzero(np.isclose(strains, lowest, 0, 1e-9))
    return along[at[0]] if at.size else np.full(along.shape[1], np.nan)
