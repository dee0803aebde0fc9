"""Strains of the unit cells, and their sizes (paper, Sec. "Kinematics under tension")."""

from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.observables.observable import Group, cells, curve, number, observable

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest

OTHER_LOADS = Group(
    "loaded", "Loads other than along the warp", lambda case: case.load.kind != "warp"
)


@observable(
    strain_xx=cells("local strain along the weft"),
    strain_yy=cells("local strain along the warp"),
    mean_strain_xx=curve(
        "mean strain along the weft", description="mean over the central unit cells"
    ),
    mean_strain_yy=curve(
        "mean strain along the warp", description="mean over the central unit cells"
    ),
)
def strains(test: "FinishedTest") -> dict[str, Any]:
    """Local strains, and their means over the central unit cells."""
    local_xx, local_yy = test.strains
    mean_xx, mean_yy = test.mean_strains
    return {
        "strain_xx": local_xx,
        "strain_yy": local_yy,
        "mean_strain_xx": mean_xx,
        "mean_strain_yy": mean_yy,
    }


@observable(
    OTHER_LOADS,
    mean_strain_xy=curve(
        "mean shear strain",
        description=(
            "shift of courses along themselves over their relaxed distance, mean over the "
            "central unit cells; the courses keep their direction"
        ),
    ),
    load_direction=number(
        "direction of the pull, from the courses",
        "degree",
        description=(
            "the reaction force acts on the width across it, of (x, y) (x sin, y cos); 90 "
            "under shear"
        ),
    ),
)
def shear_strain(test: "FinishedTest") -> dict[str, Any]:
    """Shift of the courses along themselves, and the direction of the pull."""
    from knitlab.observables.unit_cells import central_mean

    return {
        "mean_strain_xy": np.asarray(central_mean(test.gradient[..., 0, 1])),
        "load_direction": test.case.load.angle_of_pull,
    }


@observable(
    unrelaxed=True,
    flat_cell_x=number("flat unit cell along the weft", "mm"),
    flat_cell_y=number("flat unit cell along the warp", "mm"),
)
def flat_cell(test: "FinishedTest") -> dict[str, Any]:
    """Mean sides of the central unit cells on the flat sheet."""
    width, height = test.case.flat_cell
    return {"flat_cell_x": width, "flat_cell_y": height}


@observable(
    relaxed_cell_x=number("relaxed unit cell along the weft", "mm"),
    relaxed_cell_y=number("relaxed unit cell along the warp", "mm"),
)
def relaxed_cell(test: "FinishedTest") -> dict[str, Any]:
    """Mean sides of the central unit cells of the relaxed fabric."""
    from knitlab.observables.unit_cells import mean_cell_size

    width, height = mean_cell_size(test.corners[0])
    return {"relaxed_cell_x": float(width), "relaxed_cell_y": float(height)}
