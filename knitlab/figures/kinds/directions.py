"""Pulls at every angle to the courses: Poisson's ratio and stiffness as polar plots."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from knitlab.cubes.cube_file import parameters_of
from knitlab.figures.cells import not_run
from knitlab.figures.registry import figure
from knitlab.figures.style import CATEGORY_COLOURS, MARKERS, Look, frame_polar, subplots
from knitlab.io.errors import invalid
from knitlab.observables.schema import DESIGN_DIMS, STRAIN
from knitlab.observables.status import Status

ANGLE = "load_angle"
MIN_ANGLES = 3  # angles
MAX_DESIGNS = len(MARKERS)  # designs whose curves can be told apart


@figure(coordinates=(STRAIN,), compares=True)
def directions(cube: xr.Dataset) -> Figure:
    """Poisson's ratio and force over width against the angle of the pull, as polar plots.

    0° is along the courses (weft), 90° along the wales (warp). Pulls in opposite directions are the
    same. The strain is the one selected, or the largest at which all pulls have a Poisson's ratio.
    """
    if cube.sizes.get(ANGLE, 0) < MIN_ANGLES:
        hint = "run one with load = off_axis and load_angle = 0,15,…,90"
        message = f"compares {MIN_ANGLES} or more angles of pull, which this cube has not"
        raise invalid("directions", f"{message}; {hint}")
    stacked = cube.stack(design=DESIGN_DIMS).transpose("design", ANGLE, STRAIN, ...)
    stacked = stacked.isel(design=(stacked["status"] == Status.ok).any(ANGLE).values)
    if not (count := stacked.sizes["design"]):
        raise not_run()
    if count > MAX_DESIGNS:
        raise invalid(
            "directions", f"shows at most {MAX_DESIGNS} designs, not {count}; select some"
        )
    complete = stacked["poisson_ratio"].notnull().all(["design", ANGLE]).values
    if not complete.any():
        raise invalid("directions", "there is no strain at which all pulls have a Poisson's ratio")
    at = stacked.isel({STRAIN: int(np.flatnonzero(complete)[-1])})
    figure, (ratio, force) = subplots(4.2, 1, 2, subplot_kw={"projection": "polar"})
    # A checkerboard is its own mirror image: a quarter of the directions tells the others.
    mirrored = parameters_of(cube).get("pattern") == ["GR", "RG"]
    _draw(ratio, at["poisson_ratio"], "Poisson's ratio", mirrored)
    _draw(force, 10 * at["force_per_width"], "force over width [N/cm]", mirrored)
    figure.suptitle(f"at an applied strain of {float(at[STRAIN]):.0%}", fontsize="small")
    figure.legend(*ratio.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw(axes: PolarAxes, values: xr.DataArray, title: str, mirrored: bool) -> None:
    angles = np.deg2rad(values[ANGLE].values)
    whole, order = np.concatenate([angles, angles + np.pi]), [1, 1]
    if mirrored and np.isclose(angles[-1] - angles[0], np.pi / 2):
        whole = np.concatenate([angles, np.pi - angles[::-1], np.pi + angles, -angles[::-1]])
        order = [1, -1] * 2
    for row, colour, marker in zip(values, CATEGORY_COLOURS, MARKERS, strict=False):
        n_stripe, n_subunit = row["design"].item()
        look: Look = {"label": f"({n_stripe}, {n_subunit})", "lw": 0.9, "ms": 3}
        curve = np.concatenate([row.values[::step] for step in order])
        axes.plot([*whole, whole[0]], [*curve, curve[0]], color=colour, marker=marker, **look)
    frame_polar(axes, title, ["0°\ncourses", "45°", "90° wales"])
