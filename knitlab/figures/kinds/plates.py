"""In-plane stiffness of periodic fabric along every direction."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from knitlab.figures import sheets
from knitlab.figures.kinds import FigureKind
from knitlab.figures.style import TWO_COLUMNS, shades
from knitlab.io.errors import fault

MOST_STATES = 4
ANGLES = np.linspace(0, 2 * np.pi, 361)


def polar_moduli(case: xr.Dataset) -> Figure:
    """Modulus and Poisson's ratio of periodic fabric along every direction, kept flat.

    Of small changes from the relaxed state and from stretched ones, at most four unless they are
    selected. Outside the black circle Poisson's ratio is positive.
    """
    from knitlab.plate.plate_stiffness import in_plane, plates_of_case

    plates = plates_of_case(case)
    known = np.isfinite(plates["modulus_x"]) & np.isfinite(plates["modulus_y"])
    plates = plates.isel(applied_strain=np.flatnonzero(known))
    count = plates.sizes["applied_strain"]
    if not count:
        raise fault("polar", "shows stiffness, and no state that is left has any; select others")
    if count > MOST_STATES:
        shown = np.unique(np.linspace(0, count - 1, MOST_STATES).round().astype(int))
        plates = plates.isel(applied_strain=shown)
    figure = Figure(figsize=(TWO_COLUMNS, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    handles = []
    for k, colour in enumerate(shades(plates.sizes["applied_strain"])):
        state = plates.isel(applied_strain=k)
        curves = in_plane(state["membrane_stiffness"].values, ANGLES)
        for axes, values in zip(panels, curves, strict=True):
            axes.plot(ANGLES, values, color=colour)
        label = sheets.state_text(float(state["applied_strain"]))
        handles.append(Line2D([], [], color=colour, label=label))
    unit = "N/mm" if plates.attrs["length_unit"] == "mm" else f"N per {plates.attrs['length_unit']}"
    for axes, title in zip(panels, (f"modulus [{unit}]", "Poisson's ratio [1]"), strict=True):
        _frame(axes, title)
    figure.suptitle(sheets.design_text(case), fontsize="medium")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _frame(axes: PolarAxes, title: str) -> None:
    """Circles for values, from 0 or, if some are negative, from below them, and directions."""
    values = np.concatenate([np.asarray(line.get_ydata()) for line in axes.lines])
    low, high = min(values.min(), 0), max(values.max(), 0)
    if low < 0:
        low -= 0.25 * (high - low)
        axes.plot(ANGLES, 0 * ANGLES, color="black", lw=0.8)
    axes.set_rlim(low, high + 0.05 * (high - low))
    axes.set_title(title, pad=12)
    axes.set_thetagrids(range(0, 360, 45), ["         x, course", "", "y, wale", *[""] * 5])
    axes.set_rlabel_position(22)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(axis="y", labelsize=6)
    axes.grid(color="0.88", lw=0.5)
    axes.spines["polar"].set_color("0.88")


FIGURES = {
    "polar": FigureKind(polar_moduli, None, needs="position", coordinates=("applied_strain",)),
}
