"""Loads under which the lattice of periodic fabric shears.

The fabric is described in the axes of its load: its lengths are those across and along the pull of
a square as large as its unit cell, by whose stretch and shear the cell deforms.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from knitlab.model.network import MeshShape
from knitlab.solvers.loads.load import Drive, Load, Y, in_direction

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.solvers.combination import Combination


@dataclass(frozen=True)
class ShearedLattice(Load):
    """What loads under which the lattice shears have in common."""

    shears: ClassVar[bool] = True

    def in_its_axes(
        self, shape: MeshShape, relaxed: "Configuration"
    ) -> "tuple[MeshShape, Configuration]":
        """Relaxed periodic fabric in axes of which y is the pulled direction, or x the sheared."""
        if not shape.periodic:
            return shape, relaxed
        angle = np.deg2rad(self.angle_of_pull)
        from knitlab.model.fabric import Configuration

        turn = np.array([[np.sin(angle), -np.cos(angle)], [np.cos(angle), np.sin(angle)]])
        turn = turn.round(15)
        x, y, *shear = np.asarray(relaxed.lengths).tolist()
        side = math.sqrt(x * y)
        (a, b), (c, d) = (turn @ [[x, sum(shear)], [0.0, y]] / side).tolist()
        nodes = np.asarray(relaxed.positions)
        turned = np.concatenate([nodes[..., :2] @ turn.T, nodes[..., 2:]], axis=-1)
        lengths = np.array([side, side, 0.0])
        return replace(shape, frame=((a, b), (c, d))), Configuration(turned, lengths)

    def drive_of_lattice(
        self, shape: MeshShape, relaxed: "Configuration", component: int, number: int
    ) -> Drive:
        """Displacements along a component, by the place along the pull, and of one length [mm]."""
        assert shape.frame is not None
        lines, side = relaxed.positions[..., Y], relaxed.lengths[0]
        width = math.hypot(*shape.frame[0])  # of the unit cell across the pull, over the side
        grown = np.eye(3)[number] * side
        return in_direction(component, lines, grown).flattened(), side / width

    def conflicts(self, combination: "Combination") -> Iterator[str]:
        """The dynamics and electrodes of periodic fabric, besides what other loads refuse."""
        periodic = "periodic" in combination.boundaries
        if periodic and combination.method == "dynamics":
            yield "needs equilibria on periodic fabric; take method = equilibrium"
        yield from super().conflicts(combination)
        if periodic and combination.electrodes:
            yield (
                "shears the lattice of periodic fabric, whose electrodes cannot be computed; leave"
                " them out, or shear a clamped sample"
            )
