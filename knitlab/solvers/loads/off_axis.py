"""A pull of periodic fabric at an angle to the courses."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from knitlab.model.network import MeshShape
from knitlab.solvers.loads.load import Drive, LoadSetting, Y
from knitlab.solvers.loads.sheared_lattice import ShearedLattice

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.solvers.combination import Combination


@dataclass(frozen=True)
class OffAxis(ShearedLattice):
    """A pull of periodic fabric at ``angle`` to the courses; its sides are free."""

    kind: str = "off_axis"
    settings: ClassVar[tuple[LoadSetting, ...]] = (
        LoadSetting("angle", "load_angle", "degrees from the courses"),
    )

    @property
    def angle_of_pull(self) -> float:
        """Angle from the courses to the direction that is pulled [degree]."""
        return self.angle

    def drive(self, shape: MeshShape, relaxed: "Configuration") -> Drive:
        """The stretch of the lattice along the pull [mm]."""
        return self.drive_of_lattice(shape, relaxed, component=Y, number=1)

    def conflicts(self, combination: "Combination") -> Iterator[str]:
        """Clamps, besides what other loads of a sheared lattice refuse."""
        if "clamped" in combination.boundaries:
            yield "cannot act between clamps; take boundary = periodic"
        yield from super().conflicts(combination)
