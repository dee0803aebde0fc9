"""Force, tangent stiffness and energy of a tensile test."""

from collections.abc import Sequence

import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.curves import Row, draw_curves
from knitlab.figures.registry import figure
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

ROWS = {
    "force_per_width": Row("force over width\n[N/cm]", 10.0),
    "tangent_stiffness": Row("tangent stiffness\n[N/cm]", 10.0),
    "stretch_energy": Row("energy to stretch\n[mJ/cm²]", 100.0),
}


@figure(several="experiments", coordinates=(STRAIN,))
def force(cubes: Sequence[xr.Dataset]) -> Figure:
    """Force over the width of the cloth, tangent stiffness and energy, against applied strain.

    The width is that of the relaxed fabric, in cloth by the gauge; the energy is that over its
    area.
    """
    if not any("force_per_width" in cube for cube in cubes):
        raise invalid("force", "shows force over width, and no cube has any; simulate patches")
    # Energy rises from 0, so that this corner is free.
    return draw_curves(cubes, ROWS, legend=("stretch_energy", "upper left"))
