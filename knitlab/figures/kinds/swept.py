"""Any variable of all designs, along a swept setting."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cubes.cube_file import base_dims, swept_dims
from knitlab.figures import style
from knitlab.figures.kinds.grid import with_number
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, Look, number, subplots
from knitlab.io.errors import invalid
from knitlab.observables.status import Status


@figure(dims=None, options=("of",), compares=True)
def swept(cube: xr.Dataset, of: str = "poisson_ratio_min") -> Figure:
    """Any variable of every design, at each value of a swept setting.

    The legend counts the designs that have no value there. ``of`` may be a reduction, as in
    queries: ``slope(capacitance, 0.1:0.3)``.
    """
    cube = with_number(cube, of)
    swept = [dim for dim in swept_dims(cube) if cube.sizes[dim] > 1]
    designs = base_dims(cube)
    if {*cube[of].dims} - {*swept, *designs}:
        raise invalid("of", f"{of} is not one number of a design; choose another, or reduce it")
    if len(swept) != 1:
        message = f"sweeps {', '.join(swept)}; select one value of all but one"
        none = "has no swept setting; give several values of one to a workflow"
        raise invalid("swept", f"the cube {message if swept else none}")
    (setting,) = swept
    if cube.sizes[setting] > len(MARKERS):
        # More could not be distinguished.
        raise invalid("swept", f"shows at most {len(MARKERS)} values of {setting}; select fewer")
    rows = cube[["status", of]].stack(design=designs).transpose("design", setting)
    rows = rows.isel(design=(rows["status"] != Status.excluded).any(setting).values)
    names = [f"({', '.join(map(str, design))})" for design in rows["design"].values]
    if not np.isfinite(rows[of].where(rows["status"] == Status.ok)).any():
        raise invalid("of", f"{of} has no value in this selection; choose another variable")
    figure, axes = subplots(max(2.4, 1.1 + 0.16 * len(names)))
    for k, value in enumerate(rows[setting].values):
        one = rows.isel({setting: k})
        values = one[of].where(one["status"] == Status.ok)
        missing = int((values.isnull() & (one["status"] != Status.excluded)).sum())
        label = value if isinstance(value, str) else number(float(value), ".4g")
        label += f" ({missing} without value)" if missing else ""
        look: Look = {"ms": 4.5, "mfc": "none", "color": CATEGORY_COLOURS[k], "label": label}
        axes.plot(values, np.arange(len(names)), MARKERS[k], **look)
    style.name_rows(axes, names, fontsize=6.5)
    axes.set(xlabel=style.variable_label(cube[of]), ylabel=f"({', '.join(designs)})")
    axes.grid(axis="y", color="0.9", lw=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(axis="y", length=0)
    figure.legend(title=setting, loc="outside right upper")
    return figure
