"""A swept setting: any variable of every design, at each value of the setting."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cube.cube_file import base_dims, swept_dims
from knitlab.cube.schema import FLAGS, Status
from knitlab.cube.strain_window import with_columns
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, TWO_COLUMNS, Look, name_rows, number
from knitlab.io.errors import fault, unknown


def swept_values(cube: xr.Dataset, of: str = "poisson_ratio_min") -> Figure:
    """Any variable of every design, at each value of a swept setting.

    A row is a design, and a mark is a value of the setting, such as a layout of electrodes. The
    legend counts the designs that have no value there. Every other setting needs one value, and
    ``of`` may be a reduction, as in queries: ``slope(capacitance, 0.1:0.3)``.
    """
    (cube,) = with_columns([cube], [of])
    if of not in cube.data_vars:
        raise fault("of", unknown(of, map(str, cube.data_vars), "variable"))
    swept = [dim for dim in swept_dims(cube) if cube.sizes[dim] > 1]
    designs = base_dims(cube)
    if of in FLAGS or cube[of].dtype.kind not in "iuf" or {*cube[of].dims} - {*swept, *designs}:
        raise fault("of", f"{of} is not a single number of a design; choose another, or reduce it")
    if not swept:
        problem = "the cube has no swept setting; give several values of one to a workflow"
        raise fault("swept", problem)
    setting, *others = swept
    if others:
        problem = f"the cube sweeps {', '.join(swept)}; select one value of all but one"
        raise fault("swept", problem)
    if cube.sizes[setting] > len(MARKERS):
        # More could not be distinguished.
        raise fault("swept", f"shows at most {len(MARKERS)} values of {setting}; select fewer")
    rows = cube[["status", of]].stack(design=designs).transpose("design", setting)
    rows = rows.isel(design=(rows["status"] != Status.excluded).any(setting).values)
    names = [f"({', '.join(map(str, design))})" for design in rows["design"].values]
    height = max(2.4, 1.1 + 0.16 * len(names))
    figure = Figure(figsize=(TWO_COLUMNS, height), layout="constrained")
    axes = figure.add_subplot()
    for k, value in enumerate(rows[setting].values):
        one = rows.isel({setting: k})
        values = one[of].where(one["status"] == Status.ok)
        missing = int((values.isnull() & (one["status"] != Status.excluded)).sum())
        label = value if isinstance(value, str) else number(float(value), ".4g")
        label += f" ({missing} without value)" if missing else ""
        look: Look = {"ms": 4.5, "mfc": "none", "color": CATEGORY_COLOURS[k], "label": label}
        axes.plot(values, np.arange(len(names)), MARKERS[k], **look)
    unit, name = (cube[of].attrs.get(key) for key in ("units", "long_name"))
    name_rows(axes, names, fontsize=6.5)
    axes.set(xlabel=f"{name or of} [{unit or '1'}]", ylabel=f"({', '.join(designs)})")
    axes.grid(axis="y", color="0.9", lw=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(axis="y", length=0)
    figure.legend(title=setting, loc="outside right upper")
    return figure


FIGURES = {"swept": FigureKind(swept_values, dims=None, options=("of",))}
