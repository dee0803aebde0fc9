"""Local strain over samples between clamps (paper, Fig. "tension images")."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from knitlab.cube.cube_file import is_measured, source_of
from knitlab.cube.schema import Status
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.style import TWO_COLUMNS
from knitlab.figures.value_colours import ValueColours
from knitlab.io.errors import fault
from knitlab.measure.central import central

SHOWN_STRAIN = 0.23
PAPER_DESIGNS = ((8, 48), (4, 16), (4, 32))
CENTRAL: dict[str, Any] = {"fill": False, "ec": "0.2", "lw": 1.2}
COMPONENTS = {
    "strain_xx": "transverse strain $\\varepsilon_{xx}$",
    "strain_yy": "axial strain $\\varepsilon_{yy}$",
}


def tension_maps(cubes: Sequence[xr.Dataset]) -> Figure:
    """Local strain over samples between clamps (paper, Fig. "tension images").

    Shows every unit cell of the paper's three samples, and of measured samples of any design, at
    ``applied_strain`` or the recorded strain nearest 0.23. Cells have the size of the relaxed unit
    cell, and are white if they lost a marker; the central ones, over which strains are averaged,
    have a dark frame.

    Raises:
        BadInput: if none of the three has been simulated with more than one unit cell.
    """
    shown = [
        cube.sel(n_stripe=n, n_subunit=m)
        for n, m in _designs(cubes)
        for cube in cubes
        if _has_field(cube, n, m)
    ]
    if not shown:
        names = ", ".join(map(str, PAPER_DESIGNS))
        raise fault("tension", f"no cube has one of {names} with more than one unit cell")
    strains = [shown_strain(design) for design in shown]
    fields = {
        name: [design[name].sel(applied_strain=e) for design, e in zip(shown, strains, strict=True)]
        for name in COMPONENTS
    }
    figure = Figure(figsize=(TWO_COLUMNS, 5.2), layout="constrained")
    grid = figure.subplots(len(COMPONENTS), len(shown), squeeze=False)
    for row, (name, label) in zip(grid, COMPONENTS.items(), strict=True):
        colours = ValueColours.of(
            np.concatenate([field.values.ravel() for field in fields[name]]), signed=True
        )
        for axes, design, field in zip(row, shown, fields[name], strict=True):
            _draw_cells(axes, design, field, colours)
            title = f"({int(design['n_stripe'])}, {int(design['n_subunit'])})"
            if is_measured(design):
                title += f" {source_of(design)}"
            axes.set(xlabel="x, weft [mm]", ylabel="y, warp [mm]", aspect="equal", title=title)
        colours.bar(figure, list(row), label=f"{label} [1]", shrink=0.9)
    percentages = " and ".join(f"{strain:.0%}" for strain in dict.fromkeys(strains))
    figure.suptitle(f"applied strain {percentages}", fontsize="medium")
    figure.legend(
        handles=[Patch(**CENTRAL, label="unit cells over which strains are averaged")],
        loc="outside lower center",
        frameon=False,
    )
    return figure


def _designs(cubes: Sequence[xr.Dataset]) -> list[tuple[int, int]]:
    """The designs of the paper's three samples, and of all measured ones."""
    measured = [
        (n, m)
        for cube in cubes
        if is_measured(cube)
        for n in cube["n_stripe"].values.tolist()
        for m in cube["n_subunit"].values.tolist()
    ]
    return list(dict.fromkeys([*PAPER_DESIGNS, *measured]))


def shown_strain(cube: xr.Dataset) -> float:
    """The recorded applied strain nearest :data:`SHOWN_STRAIN` [1]."""
    strains = cube["applied_strain"].values
    return float(strains[np.abs(strains - SHOWN_STRAIN).argmin()])


def _has_field(cube: xr.Dataset, n_stripe: int, n_subunit: int) -> bool:
    if "strain_xx" not in cube:
        return False
    if n_stripe not in cube["n_stripe"] or n_subunit not in cube["n_subunit"]:
        return False
    design = cube.sel(n_stripe=n_stripe, n_subunit=n_subunit)
    field = design["strain_xx"].sel(applied_strain=shown_strain(design))
    return int(design["status"]) == Status.ok and int(field.notnull().sum()) > 1


def _draw_cells(axes: Axes, design: xr.Dataset, field: xr.DataArray, colours: ValueColours) -> None:
    observed = field.dropna("cell_y", how="all").dropna("cell_x", how="all")
    rows, columns = observed.shape
    width, height = float(design["relaxed_cell_x"]), float(design["relaxed_cell_y"])
    axes.pcolormesh(
        width * np.arange(columns + 1),
        height * np.arange(rows + 1),
        observed.values,
        cmap=colours.colours,
        norm=colours.norm,
        edgecolors="0.8",
        lw=0.3,
    )
    inner_y, inner_x = central(rows), central(columns)
    axes.add_patch(
        Rectangle(
            (width * inner_x.start, height * inner_y.start),
            width * (inner_x.stop - inner_x.start),
            height * (inner_y.stop - inner_y.start),
            **CENTRAL,
        )
    )


FIGURE = FigureKind(tension_maps, several="experiments", coordinates=("applied_strain",))
