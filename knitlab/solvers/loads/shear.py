"""Simple shear: courses move along themselves."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from knitlab.model.network import MeshShape
from knitlab.solvers.loads.load import Drive, X, Y, in_direction, stretch_along
from knitlab.solvers.loads.sheared_lattice import ShearedLattice

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration


@dataclass(frozen=True)
class Shear(ShearedLattice):
    """Courses move along themselves by ε times their distance.

    A sample is sheared between its clamps at a constant distance, periodic fabric with free sides.
    """

    kind: str = "shear"
    prescribed: ClassVar[tuple[int, ...]] = (2,)
    has_poisson_ratio: ClassVar[bool] = False

    def drive(self, shape: MeshShape, relaxed: "Configuration") -> Drive:
        """Displacements along x, by the distance from the bottom row [mm]."""
        if shape.frame is not None:
            return self.drive_of_lattice(shape, relaxed, component=X, number=2)
        moved, grown, length = stretch_along(shape, relaxed, Y)
        return in_direction(X, moved, np.eye(2)[Y] * grown).flattened(), length
