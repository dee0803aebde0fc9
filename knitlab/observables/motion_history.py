"""The motion of a fabric that relaxes or is pulled in time."""

from typing import TYPE_CHECKING, Any

from knitlab.observables.observable import (
    Group,
    curve,
    motion,
    number,
    observable,
    snapshot,
    snapshot_nodes,
)
from knitlab.observables.shapes import LENGTHS, periodic_lengths

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest

DYNAMICS = Group("dynamics", "Dynamics", lambda case: case.relaxes_by_dynamics)


@observable(
    DYNAMICS,
    unrelaxed=True,
    kinetic_energy_peak=curve("largest kinetic energy on the way to a strain", "N mm"),
)
def kinetic_energy_peak(test: "FinishedTest") -> list[float]:
    """Largest kinetic energy on the way to every strain."""
    return [state.kinetic_peak for state in test.test.states]


@observable(
    DYNAMICS,
    unrelaxed=True,
    kinetic_energy_left=number(
        "kinetic energy left when relaxed",
        description="at the end of the motion, over the largest while relaxing from the flat sheet",
    ),
    relaxation_force_left=number(
        "force left when relaxed",
        description="largest on a node at the end of the motion, over that on the flat sheet",
    ),
    relaxation_time=number("duration of the relaxation", "ms"),
    kinetic_energy=motion("kinetic energy", "N mm"),
    potential_energy=motion("elastic energy", "N mm"),
    dissipated_work=motion("work done against the drag", "N mm"),
    snapshot_position=snapshot_nodes("node position while relaxing", "mm"),
    snapshot_length_x=snapshot("length of periodic fabric along the weft", "mm"),
    snapshot_length_y=snapshot("length of periodic fabric along the warp", "mm"),
)
def history(test: "FinishedTest") -> dict[str, Any]:
    """The history of the relaxation: energies along time, and snapshots."""
    history = test.test.history
    if history is None:
        return {}
    names = tuple(f"snapshot_{name}" for name in LENGTHS)
    return {
        "time": history.time,
        "kinetic_energy": history.kinetic,
        "kinetic_energy_left": float(history.kinetic[-1] / history.kinetic.max()),
        "relaxation_force_left": history.force_left,
        "relaxation_time": float(history.time[-1]),
        "potential_energy": history.potential,
        "dissipated_work": history.dissipated,
        "snapshot": history.snapshot_time,
        "snapshot_position": history.snapshots.positions,
        **periodic_lengths(test, history.snapshots, names[:2]),
    }
