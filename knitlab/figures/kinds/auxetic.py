"""Design map of the lowest Poisson's ratio."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.cells import marks_legend, planned_designs
from knitlab.figures.design_map import draw_map, explained, row_count, value_marks
from knitlab.figures.registry import figure
from knitlab.figures.style import number, subplots
from knitlab.io.errors import invalid
from knitlab.observables.schema import STRAIN

LARGE_SPREAD = 0.05  # of Poisson's ratio over perturbed copies of a design: the map states it
SPREAD_NOTE = "spread: difference in ν between slightly different fabrics, docs/how-to/spread.md"
FORCE = "force_per_width"
RATIOS = ("poisson_ratio", "poisson_ratio_min")
NO_RATIO = "no ratio: not stretched, or a single clamped cell"


@figure(several="experiments", coordinates=(STRAIN,))
def auxetic(cubes: Sequence[xr.Dataset]) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain at which it occurs.

    With one applied strain selected, it shows Poisson's ratio there. Where ν of
    slightly different copies of a design differs by more than 0.05 at any strain, the map states
    the difference. Of tests without Poisson's ratio, as under shear, it shows the force at the
    largest strain.
    """
    if not any("poisson_ratio_min" in cube for cube in cubes):
        raise invalid("auxetic", "shows Poisson's ratio, and there is none; import markers")
    if forces := _forces(cubes):
        return forces
    strains = np.unique(np.concatenate([cube[STRAIN].values for cube in cubes]))
    lowest = len(strains) > 1 or strains[0] == 0
    if not lowest:
        cubes = [cube.isel(applied_strain=0) for cube in cubes]
    name = "poisson_ratio_min" if lowest else "poisson_ratio"
    designs = [design for cube in cubes for design in planned_designs(cube)]

    def text(value: float, design: xr.Dataset) -> str:
        shown = f"{number(value)}{value_marks(name, design)}"
        if lowest:
            shown += f"\nat {float(design['applied_strain_at_min']):.0%}"
        spread = _spread(design)
        return f"{shown}\nspread {spread:.2f}" if spread > LARGE_SPREAD else shown

    figure, axes = subplots(max(2.4, 1.2 + 0.5 * row_count(designs)))
    label = "lowest Poisson's ratio ν" if lowest else f"Poisson's ratio ν at {strains[0]:.0%}"
    label += "\n(negative: auxetic)"
    marked = draw_map(axes, cubes, name, label, text, signed=True)
    said = "lowest ν, and the applied strain there" if lowest else "ν"
    notes = [f"in each cell: (n_stripe, n_subunit), {said}"]
    if any(_spread(cube) > LARGE_SPREAD for cube in cubes):
        notes.append(SPREAD_NOTE)
    notes += explained([name], designs)
    marks_legend(figure, marked, NO_RATIO, notes, cubes)
    return figure


def _forces(cubes: Sequence[xr.Dataset]) -> Figure | None:
    """Map of the force at the largest strain, of tests that have it and no Poisson's ratio."""
    has_ratio = any(_any(cube, name) for name in RATIOS for cube in cubes)
    if has_ratio or not all(_any(cube, FORCE) for cube in cubes):
        return None
    shown = [10 * cube[[FORCE]].isel({STRAIN: -1}) for cube in cubes]
    shown = [one.assign(status=cube["status"]) for one, cube in zip(shown, cubes, strict=True)]
    designs = [design for cube in shown for design in planned_designs(cube)]
    figure, axes = subplots(max(2.4, 1.2 + 0.5 * row_count(designs)))
    label = f"force over width\nat {float(shown[0][STRAIN]):.0%} [N/cm]"
    marked = draw_map(axes, shown, FORCE, label, lambda value, _: number(value, ".3g"))
    notes = ["in each cell: (n_stripe, n_subunit), force: this load gives no Poisson's ratio"]
    marks_legend(figure, marked, "no force", notes, cubes)
    return figure


def _any(cube: xr.Dataset, name: str) -> bool:
    return name in cube and bool(cube[name].notnull().any())


def _spread(cube: xr.Dataset) -> float:
    """Largest spread of ν over perturbed copies, at any strain of any design; NaN without them."""
    if "poisson_ratio_low" not in cube:
        return float("nan")
    return float((cube["poisson_ratio_high"] - cube["poisson_ratio_low"]).max())
