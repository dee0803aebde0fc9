"""How far the sheet of a pure stripe departs from its zigzag.

python docs/examples/departure.py draws departure.png beside it, from the kept cube of stripes: the
difference in force relative to that of the zigzag. The legend states up to which applied strain
every sheet stays within 5 %.
"""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import knitlab as kl
from knitlab.figures.figure_files import draw_into
from knitlab.figures.kinds.stripes import coloured_stripes, stripe_panels

CUBE = Path(__file__).parents[2] / "results" / "reference" / "stripes"
LINES = {"periodic": "-", "clamped": "--"}
AGREEMENT = 0.05
"""Relative difference within which the two models count as equal."""


def draw(cube: xr.Dataset) -> Figure:
    """A panel for each knit, with the curves of its stripes."""
    figure, panels = stripe_panels(cube)
    lines = {boundary: LINES[boundary] for boundary in cube["boundary"].values}
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        axes.axhspan(-100 * AGREEMENT, 100 * AGREEMENT, color="0.93", lw=0)
        axes.axhline(0, color="0.7", lw=0.6)
        for colour, stripe in coloured_stripes(cube, knit):
            departure = (stripe["row_force"] / stripe["zigzag_force"] - 1)[:, 1:]
            for boundary, line in lines.items():
                curve = 100 * departure.sel(boundary=boundary)
                axes.plot(curve["applied_strain"], curve, ls=line, color=colour)
            label = f"{int(stripe['n'])}: {agreed_strain(departure):.0%}"
            axes.plot([], [], color=colour, label=label)
        axes.set(ylabel="force beyond the zigzag's [%]", ylim=(-7, 30))
        # The curves fill the panel.
        axes.legend(
            title=f"stripe $n$,\nwithin {AGREEMENT:.0%}\nto a strain of",
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            handlelength=1.5,
            title_fontsize="small",
        )
    handles: list[Artist] = [
        Line2D([], [], color="0.3", ls=line, label=f"3D sheet, {boundary}")
        for boundary, line in lines.items()
    ]
    handles.append(Patch(color="0.93", label=f"within {AGREEMENT:.0%}"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def agreed_strain(departure: xr.DataArray) -> float:
    """Largest applied strain up to which no sheet departs by more than :data:`AGREEMENT`."""
    beyond = abs(departure).max("boundary").values > AGREEMENT
    strains = departure["applied_strain"].values
    within = int(np.argmax(beyond)) if beyond.any() else len(strains)
    return float(strains[within - 1]) if within else 0.0


if __name__ == "__main__":
    draw_into(lambda: draw(kl.open_cube(CUBE)), Path(__file__).with_suffix(".png"))
