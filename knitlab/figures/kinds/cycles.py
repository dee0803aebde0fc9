"""Loading cycles with friction at the folds: loops of the force, and what every cycle changes."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from knitlab.figures.cells import not_run
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, STRAIN_LABEL, TWO_COLUMNS, shades
from knitlab.io.errors import invalid
from knitlab.observables.schema import CYCLE, STRAIN

BACK = "reaction_force_unloading"
OVER_CYCLES = {
    "energy_lost": ("energy lost [mJ/cm²]", 100.0),
    "residual_strain": ("residual strain [1]", 1.0),
    "capacitance": ("capacitance at rest [pF]", 1.0),
}
"""What is shown against the number of the cycle, with a factor on it."""


@figure(dims=None, coordinates=(CYCLE,), compares=True)
def cycles(cube: xr.Dataset) -> Figure:
    """Force during loading and unloading in every cycle, energy lost and set against its number.

    One design, as it is loaded again and again between zero and the largest strain: select one of
    a cube that has several. With electrodes their capacitance at zero strain is shown too.
    """
    if BACK not in cube:
        hint = "run it with unloading = true, cycle = 1,2,3 and fold_friction"
        raise invalid("cycles", f"needs the force of unloading; {hint}")
    if CYCLE not in cube.dims:
        cube = cube.expand_dims({CYCLE: [1]})
    others = [dim for dim in cube[BACK].dims if dim not in (CYCLE, STRAIN)]
    stacked = cube.stack(design=others) if others else cube.expand_dims("design")
    stacked = stacked.isel(design=stacked[BACK].notnull().any([CYCLE, STRAIN]).values)
    if not (count := stacked.sizes["design"]):
        raise not_run()
    if count > 1:
        raise invalid("cycles", f"shows one design that was unloaded, not {count}; select one")
    one = stacked.isel(design=0).transpose(CYCLE, STRAIN, ...)
    names = [name for name in OVER_CYCLES if name in one and one[name].notnull().any()]
    figure = Figure(figsize=(TWO_COLUMNS, 2.6), layout="constrained")
    axes = figure.subplots(1, 1 + len(names), width_ratios=[2.0, *(1.0 for _ in names)])
    loops, *numbers = np.atleast_1d(axes)
    figure.suptitle(", ".join(f"{dim} = {one[dim].item()}" for dim in others), fontsize="medium")
    _draw_loops(loops, one)
    for panel, name, colour, marker in zip(numbers, names, CATEGORY_COLOURS, MARKERS, strict=False):
        label, factor = OVER_CYCLES[name]
        values = one[name] if STRAIN not in one[name].dims else one[name].isel({STRAIN: 0})
        panel.plot(one[CYCLE], factor * values, color=colour, marker=marker, ms=4)
        panel.set(xlabel="cycle", title=label)
        panel.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        panel.margins(x=0.15, y=0.25)
    return figure


def _draw_loops(axes: Axes, one: xr.Dataset) -> None:
    strain = one[STRAIN].values
    numbers = one[CYCLE].values.tolist()
    for number, colour in zip(numbers, shades(len(numbers)), strict=True):
        loop = one.sel({CYCLE: number})
        axes.plot(strain, loop["reaction_force"], color=colour, label=f"cycle {number}")
        axes.plot(strain, loop[BACK], color=colour, ls="--")
    axes.axhline(0, color="0.6", lw=0.6, zorder=0)
    axes.set(xlabel=STRAIN_LABEL, ylabel="reaction force [N]")
    axes.set_title("loading, and unloading dashed")
    axes.legend(loc="upper left")
