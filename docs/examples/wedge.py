"""The wedge integral against boundary elements: where the fast estimate is good enough.

python docs/examples/wedge.py draws wedge.png beside it, from the kept cubes of sensors; every
point is a state of a design during loading.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

import knitlab as kl
from knitlab.figures.figure_files import save
from knitlab.figures.style import MARKERS, ONE_COLUMN, print_style, shades

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
GOOD = 0.1
"""Shaded difference, which is small enough for a first choice of designs."""


def draw() -> Figure:
    """Relative difference against the fold angle, by n_stripe and for pure stripes."""
    boards, stripes = (kl.open_cube(REFERENCE / name) for name in ("sensor", "sensor_stripes"))
    families = {f"n_stripe = {n}": boards.sel(n_stripe=n) for n in boards["n_stripe"].values}
    families |= {f"pure {knit}": stripes.sel(knit=knit) for knit in stripes["knit"].values}
    figure = Figure(figsize=(ONE_COLUMN * 1.15, 2.8), layout="constrained")
    axes = figure.add_subplot()
    looks = zip(families.items(), shades(len(families)), MARKERS, strict=False)
    for (name, family), shade, marker in looks:
        excess = (family["capacitance_wedge"] / family["capacitance"] - 1).values.ravel()
        fold = np.degrees(family["fold_between"].values.ravel())
        axes.plot(fold, excess, marker, ms=2.5, mew=0, color=shade, label=name)
    axes.axhspan(-GOOD, GOOD, color="0.92", zorder=0, label=f"within ±{GOOD:.0%}")
    axes.axhline(0, color="0.6", lw=0.6, zorder=0)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.set(
        xlabel="mean fold angle at and between the electrodes [°]",
        ylabel="wedge integral beyond\nboundary elements",
    )
    figure.legend(loc="outside upper center", ncols=3, markerscale=2)
    return figure


if __name__ == "__main__":
    with print_style():
        save(draw(), Path(__file__).with_suffix(".png"))
