"""A pull along the wales that also strains the courses."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Bool, Float

from knitlab.model.cell_grid import CellGrid
from knitlab.model.network import MeshShape
from knitlab.solvers.loads.load import (
    MAX_STRAIN,
    Drive,
    Load,
    LoadSetting,
    X,
    Y,
    in_direction,
    stretch_along,
)

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.solvers.combination import Combination
    from knitlab.solvers.loads.loading import Loading


@dataclass(frozen=True)
class Biaxial(Load):
    """A pull along both axes: ε along the warp, ``ratio`` times ε across it, along the weft.

    Clamps on all four edges of a sample let them slide along themselves; both lengths of periodic
    fabric are prescribed.
    """

    kind: str = "biaxial"
    prescribed: ClassVar[tuple[int, ...]] = (X, Y)
    pulls_across: ClassVar[bool] = True
    has_poisson_ratio: ClassVar[bool] = False
    settings: ClassVar[tuple[LoadSetting, ...]] = (
        LoadSetting("ratio", "load_ratio", "strain across the pull over that along it"),
    )

    def clamped_nodes(self, shape: MeshShape) -> Bool[np.ndarray, "node_y node_x"]:
        """Nodes of a sample that clamps hold: all edges."""
        clamped = np.zeros((shape.nodes_y, shape.nodes_x), bool)
        clamped[[0, -1]] = clamped[:, [0, -1]] = True
        return clamped & shape.nodes_of_fabric

    def free_coordinates(self, shape: MeshShape) -> Bool[np.ndarray, "node_y node_x 3"]:
        """Coordinates that are free: edges slide along themselves, but for the corners."""
        free = super().free_coordinates(shape)
        free[[0, -1], 1:-1, X] = True
        free[1:-1, [0, -1], Y] = True
        return free

    def holds_every_corner(self, cells: CellGrid) -> bool:
        """Never: edges slide."""
        return False

    def drive(self, shape: MeshShape, relaxed: "Configuration") -> Drive:
        """The pull, and ``ratio`` times that across [mm]."""
        drive, length = super().drive(shape, relaxed)
        across = 1 - self.axis
        moved, wider, _ = stretch_along(shape, relaxed, across)
        added = in_direction(across, moved, np.eye(2)[across] * wider).flattened()
        return drive + self.ratio * added, length

    def reaction_force(self, loading: "Loading", gradient: Float[np.ndarray, " unknown"]) -> float:
        """The force along the pull [N]."""
        return loading.force_along(self.axis, gradient)

    def conflicts(self, combination: "Combination") -> Iterator[str]:
        """Strains across the pull that are none, besides what other loads refuse."""
        across = self.ratio * combination.strain_max
        if not -1 < across <= MAX_STRAIN:
            yarns = "warp" if self.axis == X else "weft"
            yield (
                f"strains the {yarns} by strain_max × load_ratio = {across:g}; keep that above -1"
                f" and at most {MAX_STRAIN:g}"
            )
        yield from super().conflicts(combination)
