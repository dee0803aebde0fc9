"""Shapes of the states of a test, and where the fabric passes through itself."""

from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.observables.observable import Group, curve, nodes, observable

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.observables.finished_test import FinishedTest

LENGTHS = ("length_x", "length_y", "length_shear")
SHEARED = Group(
    "sheared",
    "Periodic fabric whose lattice shears",
    lambda case: case.load.shears and case.mesh_shape.periodic,
)


@observable(position=nodes("node position", "mm", in_cube=False))
def position(test: "FinishedTest") -> Any:
    """Positions of the nodes."""
    return test.configurations.positions


@observable(
    length_x=curve("length of the fabric along the weft", "mm", in_cube=False),
    length_y=curve("length of the fabric along the warp", "mm", in_cube=False),
)
def lengths(test: "FinishedTest") -> dict[str, Any]:
    """Lengths of periodic fabric along weft and warp."""
    return periodic_lengths(test, test.configurations, LENGTHS[:2])


@observable(
    SHEARED,
    length_shear=curve("shift of the upper end of the fabric along the weft", "mm", in_cube=False),
)
def length_shear(test: "FinishedTest") -> dict[str, Any]:
    """Shift of the upper end of periodic fabric."""
    return periodic_lengths(test, test.configurations, LENGTHS)


def periodic_lengths(
    test: "FinishedTest", configurations: "Configuration", names: tuple[str, ...]
) -> dict[str, Any]:
    """The lengths of periodic fabric, by names; none of a sample."""
    if not test.case.mesh_shape.periodic:
        return {}
    return dict(zip(names, configurations.lengths.T, strict=False))


@observable(
    hinges_past_pi=curve(
        "hinges folded past half a turn",
        description="there the fabric passes through itself, which only contact prevents",
        integer=True,
    ),
    self_intersections=curve(
        "pairs of grid cells that pass through each other",
        description=(
            "each cell as two triangles; in periodic fabric, each pair once per period. With"
            " contact there are none"
        ),
        integer=True,
    ),
)
def passed_through_itself(test: "FinishedTest") -> dict[str, Any]:
    """Hinges beyond ±π, and pairs of grid cells that cross."""
    from knitlab.model.surfaces import self_intersections
    from knitlab.observables.folds import hinges_past_pi

    intersections = self_intersections(test.case.mesh_shape, test.configurations)
    past = hinges_past_pi(*test.assembled, test.configurations)
    return {
        "hinges_past_pi": past.astype(float),
        "self_intersections": np.array(intersections, float),
    }
