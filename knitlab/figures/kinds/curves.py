"""Strains and Poisson's ratio of a tensile test."""

from collections.abc import Sequence

import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.curves import Row, draw_curves
from knitlab.figures.registry import figure
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

ROWS = {
    "mean_strain_xx": Row("strain along the weft\nmean $\\varepsilon_{xx}$ [1]"),
    "mean_strain_yy": Row("strain along the warp\nmean $\\varepsilon_{yy}$ [1]"),
    "poisson_ratio": Row("Poisson's ratio\n$\\nu$ [1]"),
}
INSTEAD = {
    "mean_strain_xy": Row("shear strain\nmean $\\varepsilon_{xy}$ [1]"),
    "force_per_width": Row("force over width\n[N/cm]", 10.0),
}
"""In place of Poisson's ratio, which no test under shear or a biaxial load has."""


@figure(several="experiments", coordinates=(STRAIN,))
def curves(cubes: Sequence[xr.Dataset]) -> Figure:
    """ε_xx, ε_yy and ν against applied strain (paper, Fig. "tension plots").

    Colour and mark encode P, the periods in a patch, in every column of n_stripe. Of tests without
    Poisson's ratio, as under shear, it shows the force.
    """
    if not any(name in cube for cube in cubes for name in ROWS):
        raise invalid("curves", "shows strains, and no cube has any; import markers")
    known = any("poisson_ratio" in one and one["poisson_ratio"].notnull().any() for one in cubes)
    strains = {name: row for name, row in ROWS.items() if name != "poisson_ratio"}
    if not known:
        return draw_curves(cubes, strains | INSTEAD, legend=("force_per_width", "upper left"))
    # Axial strain follows the diagonal, so that this corner is free.
    return draw_curves(cubes, ROWS, legend=("mean_strain_yy", "lower right"))
