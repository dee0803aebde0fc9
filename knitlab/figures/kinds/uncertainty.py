"""The uncertainty map: what that of the stripes makes of each design, and which number leads."""

from math import floor, log10
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cubes.uncertainty import LOWEST, PARAMETER, QUANTITIES, first_order
from knitlab.figures import cells
from knitlab.figures.design_map import draw_map, row_count
from knitlab.figures.kinds.sensitivity import SYMBOLS
from knitlab.figures.registry import figure
from knitlab.figures.style import number, subplots
from knitlab.io.errors import invalid, unknown
from knitlab.observables.schema import STRAIN, VARIABLES

if TYPE_CHECKING:  # which imports JAX
    from knitlab.runs.material import Material

NOTES = (
    "in each cell: (n_stripe, n_subunit), value ± half its 95 % interval, the number to measure",
    "better, and the part of the variance that would vanish if this number were known exactly",
)
LINE = 90  # characters
MAX_PLACES = 4  # decimal places of a value at most


@figure(coordinates=(STRAIN,), options=("material", "of", "uncertainty_of"))
def uncertainty(
    cube: xr.Dataset,
    material: "str | Path | Material | None" = None,
    of: str = "poisson_ratio",
    uncertainty_of: str | None = None,
) -> Figure:
    """Poisson's ratio of every design ± half its 95 % interval, and the number to measure better.

    Both follow from the covariance of the stripes of a material, to first order: the lowest ratio,
    or with one applied strain selected the ratio, or the force, there. The colour is half the
    interval; the number explains most of the variance. The interval is that of a new ``"swatch"``,
    or of the ``"mean"`` stripe, as the figure says.
    """
    from knitlab.runs.stripe_covariance import uncertain_stripes

    if material is None:
        raise invalid("material", "is not given; give the file with the covariances of its stripes")
    if of not in QUANTITIES:
        raise invalid(f"of {of}", unknown(of, QUANTITIES, "quantity"))
    single = cube.sizes[STRAIN] == 1
    if of != "poisson_ratio" and not single:
        raise invalid(f"of {of}", "varies with the strain; select one applied_strain")
    name = of if single else LOWEST
    known = first_order(cube, uncertain_stripes(material, uncertainty_of))
    shown = known.isel({STRAIN: 0}) if single else known
    unit = VARIABLES[of].units

    def text(deviation: float, design: xr.Dataset) -> str:
        explained = design[f"{name}_explained"]
        leading = int(np.argmax(explained.values))
        knit, _, symbol = str(explained[PARAMETER].values[leading]).partition("_")
        leader = f"{knit} {SYMBOLS.get(symbol, symbol)} {float(explained[leading]):.0%}"
        # Two digits of the deviation, and as many decimal places of the value.
        digits = 1 - floor(log10(deviation)) if deviation > 0 else MAX_PLACES
        form = f".{min(max(digits, 0), MAX_PLACES)}f"
        return f"{number(float(design[name]), form)} ± {deviation:{form}}\n{leader}"

    figure, axes = subplots(max(2.4, 1.2 + 0.55 * row_count(cells.planned_designs(shown))))
    what = VARIABLES[name].long_name + (f"\nat {cube[STRAIN].item():.0%}" if single else "")
    label = f"95 % half-width of the\n{what}" + ("" if unit == "1" else f" [{unit}]")
    said = wrap(f"uncertainty {known.attrs['comment']}", LINE)
    marked = draw_map(axes, [shown], f"{name}_halfwidth", label, text)
    cells.marks_legend(figure, marked, "no derivative, or no value", (*NOTES, *said))
    return figure
