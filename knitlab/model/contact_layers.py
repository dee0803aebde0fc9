"""How far parts of a fabric keep apart: those near each other on the grid, and all others."""

from dataclasses import dataclass

import numpy as np

from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.settings import CONTACT_RANGE

NEAR = 0.4
"""Distance that parts keep which are near on the grid, in thicknesses: it keeps them from passing
through each other, and leaves the calibrated folds alone."""
NEAR_CELLS = 2
"""Nodes within this many of the paper's cells of each other, along both axes, are near. A fold at
its rest angle brings them nearer than a thickness, without any force but that of its hinge."""

TRIANGLES = np.array([[[0, 0], [0, 1], [1, 1]], [[1, 1], [1, 0], [0, 0]]])
"""Triangles of a cell by corner (y, x), as in :mod:`knitlab.model.surfaces`."""


@dataclass(frozen=True)
class ContactLayer:
    """The barrier between parts: the distance that they keep, and its reach beyond that [mm]."""

    least: float
    reach: float
    force: float  # its scale, pressure times the area of a grid cell [N]

    @property
    def begins(self) -> float:
        """Distance at which the barrier begins [mm]."""
        return self.least + self.reach

    @property
    def range_squared(self) -> float:
        """Square of that distance, less the square of the least [mm²]."""
        return self.begins**2 - self.least**2

    @property
    def strength(self) -> float:
        """Factor of the barrier of squared distances, which is a length to the fourth [N/mm³]."""
        return self.force * self.reach / self.range_squared**2


@dataclass(frozen=True)
class ContactLayers:
    """Contact of a fabric with itself."""

    far: ContactLayer  # between parts that are not near each other on the grid
    near: ContactLayer  # between parts that are
    cell: float  # shortest side of a grid cell [mm]
    cells_per_period: int

    @property
    def near_cells(self) -> int:
        """Rows and columns within which nodes are near each other."""
        return NEAR_CELLS * self.cells_per_period // CELLS_PER_PERIOD


def contact_layers(
    thickness: float,
    pressure: float,
    cell: tuple[float, float],
    cells_per_period: int = CELLS_PER_PERIOD,
) -> ContactLayers:
    """Layers of a fabric whose middle surfaces touch at a distance of its thickness [mm].

    ``pressure`` is the scale of the barrier [N/mm²], ``cell`` has the mean sides (x, y) of a grid
    cell.
    """
    force = pressure * cell[0] * cell[1]
    return ContactLayers(
        far=ContactLayer(thickness, CONTACT_RANGE * thickness, force),
        near=ContactLayer(NEAR * thickness, CONTACT_RANGE * NEAR * thickness, force),
        cell=min(cell),
        cells_per_period=cells_per_period,
    )
