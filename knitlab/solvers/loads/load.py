"""What loads share, and what each declares."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float

from knitlab.model.array_library import array_library
from knitlab.model.cell_grid import CellGrid
from knitlab.model.network import MeshShape

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.solvers.combination import Combination
    from knitlab.solvers.loads.loading import Loading

X, Y = 0, 1
MAX_STRAIN = 10.0  # of a test; pure stripes unfold to about 2
Drive = tuple[Any, Any]  # arrays
"""Displacement of the unknowns per unit of strain, and the length that the strain refers to."""


@dataclass(frozen=True)
class LoadSetting:
    """A setting of ``[protocol]`` that a load needs: the attribute that it gives, and its name."""

    attribute: str
    name: str
    meaning: str


@dataclass(frozen=True)
class Load:
    """How a fabric is strained by the applied strain ε; the base of all loads.

    The base pulls two ends apart along :attr:`axis` and leaves the sides free. A load overrides
    what differs.

    Attributes:
        kind: name of the load.
        ratio: strain across the pull over that along it, of a biaxial load [1].
        angle: from the courses to the pulled direction of the relaxed fabric, of an off-axis load
            [degree].
    """

    kind: str = "warp"
    ratio: float = 0.0
    angle: float = 90.0

    axis: ClassVar[int] = Y
    """Axis along which clamps, or periods, are displaced from each other: 0 for x, 1 for y."""
    prescribed: ClassVar[tuple[int, ...]] = (Y,)
    """Lengths of periodic fabric that the load prescribes, by their number."""
    pulls_across: ClassVar[bool] = False
    """Whether the fabric is also strained across the pull."""
    shears: ClassVar[bool] = False
    """Whether the lattice of periodic fabric may shear under the load."""
    has_poisson_ratio: ClassVar[bool] = True
    """Whether a contraction across the pull is free, so that it has a Poisson's ratio."""
    settings: ClassVar[tuple[LoadSetting, ...]] = ()
    """Settings of ``[protocol]`` that it needs."""

    @property
    def angle_of_pull(self) -> float:
        """Angle from the courses to the direction that is pulled [degree]."""
        return 0.0 if self.axis == X else 90.0

    def clamped_nodes(self, shape: MeshShape) -> Bool[np.ndarray, "node_y node_x"]:
        """Nodes of a sample that clamps hold: its two ends along the axis."""
        clamped = np.zeros((shape.nodes_y, shape.nodes_x), bool)
        if self.axis == Y:
            clamped[[0, -1]] = True
        else:
            clamped[:, [0, -1]] = True
        return clamped & shape.nodes_of_fabric

    def free_coordinates(self, shape: MeshShape) -> Bool[np.ndarray, "node_y node_x 3"]:
        """Coordinates of the nodes of a sample that are free: those of nodes without a clamp."""
        return np.repeat(~self.clamped_nodes(shape)[..., None], 3, axis=-1)

    def holds_every_corner(self, cells: CellGrid) -> bool:
        """Whether every corner of a unit cell of a sample lies on a clamp: none can move across."""
        return cells.count[1 - self.axis] == 1

    def in_its_axes(
        self, shape: MeshShape, relaxed: "Configuration"
    ) -> "tuple[MeshShape, Configuration]":
        """A relaxed fabric in the axes in which the load describes it: by default its own."""
        return shape, relaxed

    def drive(self, shape: MeshShape, relaxed: "Configuration") -> Drive:
        """What moves per unit of strain, and over which length; differentiable by the shape [mm].

        The moved clamp, or the length of periodic fabric, is displaced along the axis by the
        applied strain times the relaxed length; nodes between follow affinely.
        """
        moved, grown, length = stretch_along(shape, relaxed, self.axis)
        return in_direction(self.axis, moved, np.eye(2)[self.axis] * grown).flattened(), length

    def reaction_force(self, loading: "Loading", gradient: Float[np.ndarray, " unknown"]) -> float:
        """The force that a test of this load reports [N]."""
        return loading.reaction_force(gradient)

    def conflicts(self, combination: "Combination") -> Iterator[str]:
        """What the load cannot be combined with, each with a remedy."""
        if combination.sensitivities:
            yield "has no sensitivities; leave them out, or take load = warp"


def stretch_along(shape: MeshShape, relaxed: "Configuration", axis: int) -> tuple[Any, Any, Any]:
    """Displacements of an affine stretch along an axis by 1, of nodes, length and whole length."""
    xp, lines = array_library(relaxed), relaxed.positions[..., axis]
    if shape.periodic:
        length = relaxed.lengths[axis]
        return lines, length, length
    with_fabric = shape.nodes_of_fabric
    if axis != Y:
        lines = lines.T
        with_fabric = with_fabric.T
    first, last = lines[0], lines[-1]
    if shape.spans is not None:
        first, last = first[with_fabric[0]], last[with_fabric[-1]]
    start = first.mean()
    length = last.mean() - start
    inner = xp.clip(lines[1:-1] - start, 0, length)
    ends = np.zeros((1, lines.shape[1]))
    moved = xp.concatenate([ends, inner, ends + length])
    return (moved if axis == Y else moved.T), 0.0, length


def in_direction(component: int, moved: Any, grown: Any) -> "Configuration":
    """A displacement of all nodes along one coordinate, and of the lengths."""
    from knitlab.model.fabric import Configuration  # imports JAX

    xp, still = array_library(moved), np.zeros(moved.shape)
    columns = [moved if axis == component else still for axis in range(3)]
    return Configuration(xp.stack(columns, axis=-1), grown)
