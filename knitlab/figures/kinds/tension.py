"""Local strain over samples between clamps (paper, Fig. "tension images")."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.cubes.cube_file import is_measured, source_of
from knitlab.figures.cells import design_name, planned_designs, pull_note
from knitlab.figures.registry import figure
from knitlab.figures.style import Look, colour_bar, subplots, value_colours
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import Status

SHOWN_STRAIN = 0.23
PAPER_DESIGNS = ((8, 48), (4, 16), (4, 32))
CENTRAL: Look = {"fill": False, "ec": "0.2", "lw": 1.2}
COMPONENTS = {
    "strain_xx": "transverse strain $\\varepsilon_{xx}$",
    "strain_yy": "axial strain $\\varepsilon_{yy}$",
}


@figure(several="experiments", coordinates=(STRAIN,))
def tension(cubes: Sequence[xr.Dataset]) -> Figure:
    """Local strain over samples between clamps (paper, Fig. "tension images").

    Lengths are those of the relaxed cloth, by the gauge. Shows the paper's three samples, and
    measured samples of any design, at ``applied_strain`` or the recorded strain nearest 0.23. Cells
    that lost a marker are white.
    """
    shown = _samples(cubes)
    if not shown:
        names = ", ".join(map(str, PAPER_DESIGNS))
        raise invalid("tension", f"no cube has one of {names} with more than one unit cell")
    figure, grid = subplots(5.2, len(COMPONENTS), len(shown), squeeze=False)
    for row, (name, label) in zip(grid, COMPONENTS.items(), strict=True):
        values = np.concatenate([sample[name].values.ravel() for sample in shown])
        colours = value_colours(values, signed=True)
        for axes, sample in zip(row, shown, strict=True):
            _draw_cells(axes, sample, name, colours)
            title = design_name(sample)
            title += f" {source_of(sample)}" if is_measured(sample) else ""
            axes.set(xlabel="x, weft [mm]", ylabel="y, warp [mm]", aspect="equal", title=title)
        colour_bar(list(row), colours, label=f"{label} [1]", shrink=0.9)
    strains = dict.fromkeys(f"{float(sample['applied_strain']):.0%}" for sample in shown)
    figure.suptitle(f"applied strain {' and '.join(strains)}", fontsize="medium")
    averaged = Patch(**CENTRAL, label="unit cells over which strains are averaged")
    notes = dict.fromkeys(filter(None, map(pull_note, shown)))
    handles = [averaged, *(Patch(fc="none", ec="none", label=note) for note in notes)]
    figure.legend(handles=handles, loc="outside lower center", ncols=1)
    return figure


def _samples(cubes: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """The samples at the shown strain: the paper's three, then measured ones."""
    order = {str(design): number for number, design in enumerate(PAPER_DESIGNS)}
    samples = [
        design.sel(applied_strain=SHOWN_STRAIN, method="nearest")
        for cube in cubes
        if "strain_xx" in cube
        for design in planned_designs(cube)
        if int(design["status"]) == Status.ok
        and (is_measured(design) or design_name(design) in order)
    ]
    samples = [sample for sample in samples if int(sample["strain_xx"].notnull().sum()) > 1]
    return sorted(samples, key=lambda each: order.get(design_name(each), len(order)))


def _draw_cells(axes: Axes, sample: xr.Dataset, name: str, colours: ScalarMappable) -> None:
    from knitlab.model.cell_grid import central

    observed = sample[name].dropna("cell_y", how="all").dropna("cell_x", how="all")
    rows, columns = observed.shape
    # Relaxed sizes of an experiment are those of the cloth.
    kind = "knit" if "knit_cell_x" in sample else "relaxed"
    width, height = (float(sample[f"{kind}_cell_{direction}"]) for direction in "xy")
    x, y = width * np.arange(columns + 1), height * np.arange(rows + 1)
    look: Look = {"cmap": colours.cmap, "norm": colours.norm, "edgecolors": "0.8", "lw": 0.3}
    axes.pcolormesh(x, y, observed.values, **look)
    inner_y, inner_x = central(rows), central(columns)
    corner = x[inner_x.start], y[inner_y.start]
    size = x[inner_x.stop] - x[inner_x.start], y[inner_y.stop] - y[inner_y.start]
    axes.add_patch(Rectangle(corner, *size, **CENTRAL))
