"""In-plane stiffness of periodic fabric along every direction."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knitlab.figures import sheets
from knitlab.figures.registry import figure
from knitlab.figures.style import frame_polar, shades, subplots
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

MAX_STATES = 4
ANGLES = np.linspace(0, 2 * np.pi, 361)


@figure(dims=None, needs="position", coordinates=(STRAIN,))
def polar(case: xr.Dataset) -> Figure:
    """Modulus and Poisson's ratio of periodic fabric along every direction, kept flat.

    Of small changes from the relaxed state and from stretched ones, at most four unless they are
    selected. Outside the black circle Poisson's ratio is positive.
    """
    from knitlab.export.plates.plate_stiffness import case_plates, in_plane

    plates = case_plates(case)
    known = np.isfinite(plates["modulus_x"]) & np.isfinite(plates["modulus_y"])
    plates = plates.isel(applied_strain=np.flatnonzero(known))
    count = plates.sizes["applied_strain"]
    if not count:
        raise invalid("polar", "shows stiffness, and no state that is left has any; select others")
    if count > MAX_STATES:
        shown = np.unique(np.linspace(0, count - 1, MAX_STATES).round().astype(int))
        plates = plates.isel(applied_strain=shown)
    figure, panels = subplots(3.6, 1, 2, subplot_kw={"projection": "polar"})
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
        frame_polar(axes, title, ["x, course", "", "y, wale"])
    figure.suptitle(sheets.design_text(case), fontsize="medium")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
