"""Loadings: what a test holds, what it moves and how far, and which unknowns are free."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.model.array_library import array_library
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape

LoadKind = Literal["warp", "weft", "biaxial", "shear", "off_axis"]
X, Y = 0, 1


@dataclass(frozen=True)
class Load:
    """How a fabric is strained, by the applied strain ε.

    Attributes:
        kind: ``"warp"`` pulls along the wales, as the paper does, ``"weft"`` along the courses;
            sides that are not pulled are free. ``"biaxial"`` pulls along both: ε along the warp,
            ``ratio`` times ε along the weft. ``"shear"`` moves courses along themselves by ε times
            their distance: a sample between its clamps at a constant distance, periodic fabric with
            free sides. ``"off_axis"`` pulls periodic fabric at an ``angle``, its sides free.
        ratio: strain along the weft over that along the warp, of a biaxial load [1].
        angle: from the courses to the pulled direction of the relaxed fabric, of an off-axis load
            [degree].
    """

    kind: LoadKind = "warp"
    ratio: float = 0.0
    angle: float = 90.0

    @property
    def axis(self) -> int:
        """Axis that clamps, or periods, are displaced from each other along: 0 for x, 1 for y."""
        return X if self.kind == "weft" else Y

    @property
    def angle_of_pull(self) -> float:
        """Angle from the courses to the direction that is pulled [degree]."""
        return {"weft": 0.0, "off_axis": self.angle}.get(self.kind, 90.0)

    @property
    def shears(self) -> bool:
        """Whether the lattice of periodic fabric may shear under the load."""
        return self.kind in ("shear", "off_axis")


WARP = Load()


@dataclass(frozen=True, eq=False)
class Loading:
    """A displacement-controlled test, from a relaxed configuration."""

    shape: MeshShape
    load: Load
    free: Int[np.ndarray, " free"]  # indices of the free unknowns
    reference: Float[np.ndarray, " unknown"]  # the relaxed configuration, flattened [mm]
    # per unit of strain: prescribed if held, else of an affine stretch [mm]
    drive: Float[np.ndarray, " unknown"]
    length: float  # that the applied strain refers to [mm]

    @cached_property
    def held(self) -> Int[np.ndarray, " held"]:
        """Indices of the held unknowns, L_x and L_y of an open sample among them."""
        return held_under(self.shape, self.load)

    def holding(
        self, unknowns: Float[np.ndarray, " unknown"], applied_strain: float
    ) -> Float[np.ndarray, " unknown"]:
        """The unknowns, with the held ones set as the applied strain prescribes [mm]."""
        held, moved = self.held, unknowns.copy()
        moved[held] = self.reference[held] + applied_strain * self.drive[held]
        return moved

    def ahead(
        self, passed: Sequence[tuple[float, Float[np.ndarray, " unknown"]]], applied_strain: float
    ) -> Float[np.ndarray, " unknown"]:
        """Polynomial extrapolation of states passed, or an affine stretch of only one [mm]."""
        strain, last = passed[-1]
        if len(passed) == 1:
            return self.holding(last + (applied_strain - strain) * self.drive, applied_strain)
        extrapolated = np.zeros_like(last)
        for own, unknowns in passed:
            others = [other for other, _ in passed if other != own]
            extrapolated += unknowns * math.prod(
                (applied_strain - other) / (own - other) for other in others
            )
        return self.holding(extrapolated, applied_strain)

    def reaction_force(self, gradient: Float[np.ndarray, " unknown"]) -> float:
        """Work of the test per strain, over its length: of a pull, the force on an end [N].

        That is Σ of forces on the moved clamp, or ∂V/∂L of periodic fabric. Of an off-axis load it
        acts on √((L_x sin α)² + (L_y cos α)²), the width of a unit cell across the pull.
        """
        return float(reaction_force(self.shape, self.drive, self.length, gradient, self.load))

    def force_along(self, axis: int, gradient: Float[np.ndarray, " unknown"]) -> float:
        """Force on the end of the fabric along x (0) or y (1), under a biaxial load [N]."""
        relaxed = Configuration.of(self.reference, self.shape)
        moved, grown, length = _stretch_along(self.shape, relaxed, axis)
        drive = np.asarray(_in_direction(axis, moved, np.eye(2)[axis] * grown).flattened())
        return float(drive[self.held] @ gradient[self.held] / length)


def all_free(shape: MeshShape) -> Int[np.ndarray, " free"]:
    """Free unknowns while a fabric relaxes: every coordinate, and the lengths if periodic."""
    return np.arange(shape.unknowns if shape.periodic else 3 * shape.nodes)


def clamped_nodes(shape: MeshShape, load: Load = WARP) -> Bool[np.ndarray, "node_y node_x"]:
    """Nodes of a sample that clamps hold: two rows, two columns, or, biaxially, all edges."""
    clamped = np.zeros((shape.nodes_y, shape.nodes_x), bool)
    if load.kind != "weft":
        clamped[[0, -1]] = True
    if load.kind in ("weft", "biaxial"):
        clamped[:, [0, -1]] = True
    return clamped


def free_under(shape: MeshShape, load: Load = WARP) -> Int[np.ndarray, " free"]:
    """Free unknowns of a test: all but the prescribed lengths if periodic, else those not clamped.

    Under a biaxial load the clamps let the edges of a sample slide along themselves.
    """
    free = np.ones(shape.unknowns, bool)
    if shape.periodic:
        of_lengths = {"weft": [X], "biaxial": [X, Y], "shear": [2]}.get(load.kind, [Y])
        free[3 * shape.nodes + np.array(of_lengths)] = False
        return np.flatnonzero(free)
    of_nodes = np.repeat(~clamped_nodes(shape, load)[..., None], 3, axis=-1)
    if load.kind == "biaxial":
        of_nodes[[0, -1], 1:-1, X] = True
        of_nodes[1:-1, [0, -1], Y] = True
    free[: 3 * shape.nodes], free[3 * shape.nodes :] = of_nodes.ravel(), False
    return np.flatnonzero(free)


@lru_cache(maxsize=16)
def held_under(shape: MeshShape, load: Load = WARP) -> Int[np.ndarray, " held"]:
    """Held unknowns of a test, the lengths of an open sample among them."""
    return np.setdiff1d(np.arange(shape.unknowns), free_under(shape, load))


def reaction_force(
    shape: MeshShape,
    drive: Float[Array | np.ndarray, " unknown"],
    length: Float[Array | np.ndarray, ""] | float,
    gradient: Float[Array | np.ndarray, " unknown"],
    load: Load = WARP,
) -> Float[Array, ""]:
    """See :meth:`Loading.reaction_force`; for JAX and NumPy arrays [N]."""
    held = held_under(shape, load)
    return drive[held] @ gradient[held] / length


def loading_of(shape: MeshShape, relaxed: Configuration, load: Load = WARP) -> Loading:
    """The test of a relaxed shape; the paper's pull by default (Sec. "Kinematics under tension").

    A clamped sample has its bottom row held and its top row displaced along y, by the applied
    strain times their relaxed distance. Periodic fabric has L_y prescribed and L_x free. Fabric
    whose lattice shears is described in the axes of its load: its lengths are those across and
    along the pull of a square as large as its unit cell, by whose stretch and shear that deforms.
    """
    if shape.periodic and load.shears:
        shape, relaxed = _in_axes_of(load, shape, relaxed)
    drive, length = drive_along(shape, relaxed, load)
    reference = np.asarray(relaxed.flattened())
    return Loading(
        shape, load, free_under(shape, load), reference, np.asarray(drive), float(length)
    )


def drive_along(
    shape: MeshShape, relaxed: Configuration, load: Load = WARP
) -> tuple[Float[Array | np.ndarray, " unknown"], Float[Array | np.ndarray, ""]]:
    """The drive and the length of a :class:`Loading`, differentiable by the relaxed shape [mm]."""
    if shape.frame is not None:
        lines, side = relaxed.positions[..., Y], relaxed.lengths[0]
        component, number = (X, 2) if load.kind == "shear" else (Y, 1)
        width = math.hypot(*shape.frame[0])  # of the unit cell across the pull, over the side
        return _in_direction(component, lines, np.eye(3)[number] * side).flattened(), side / width
    moved, grown, length = _stretch_along(shape, relaxed, load.axis)
    component = X if load.kind == "shear" else load.axis
    drive = _in_direction(component, moved, np.eye(2)[load.axis] * grown).flattened()
    if load.kind == "biaxial":
        across, wider, _ = _stretch_along(shape, relaxed, X)
        drive = drive + load.ratio * _in_direction(X, across, np.eye(2)[X] * wider).flattened()
    return drive, length


def _stretch_along(
    shape: MeshShape, relaxed: Configuration, axis: int
) -> tuple[Array | np.ndarray, Array | np.ndarray | float, Array | np.ndarray]:
    """Displacements of an affine stretch along an axis by 1, of nodes, length and whole length."""
    xp, lines = array_library(relaxed), relaxed.positions[..., axis]
    if shape.periodic:
        length = relaxed.lengths[axis]
        return lines, length, length
    lines = lines if axis == Y else lines.T
    length = lines[-1].mean() - lines[0].mean()
    inner = xp.clip(lines[1:-1] - lines[0].mean(), 0, length)
    ends = np.zeros((1, lines.shape[1]))
    moved = xp.concatenate([ends, inner, ends + length])
    return (moved if axis == Y else moved.T), 0.0, length


def _in_direction(
    component: int, moved: Array | np.ndarray, grown: Array | np.ndarray
) -> Configuration:
    """A displacement of all nodes along one coordinate, and of the lengths."""
    xp, still = array_library(moved), np.zeros(moved.shape)
    columns = [moved if axis == component else still for axis in range(3)]
    return Configuration(xp.stack(columns, axis=-1), grown)


def _in_axes_of(
    load: Load, shape: MeshShape, relaxed: Configuration
) -> tuple[MeshShape, Configuration]:
    """Relaxed periodic fabric in axes of which y is the pulled direction, or x the sheared one."""
    angle = np.deg2rad(load.angle if load.kind == "off_axis" else 90.0)
    turn = np.array([[np.sin(angle), -np.cos(angle)], [np.cos(angle), np.sin(angle)]]).round(15)
    x, y, *shear = np.asarray(relaxed.lengths).tolist()
    side = math.sqrt(x * y)
    (a, b), (c, d) = (turn @ [[x, sum(shear)], [0.0, y]] / side).tolist()
    nodes = np.asarray(relaxed.positions)
    turned = np.concatenate([nodes[..., :2] @ turn.T, nodes[..., 2:]], axis=-1)
    lengths = np.array([side, side, 0.0])
    return replace(shape, frame=((a, b), (c, d))), Configuration(turned, lengths)


def along_courses(shape: MeshShape, state: Configuration) -> Configuration:
    """A state of fabric with a frame, turned so that courses lie along x; lengths in mm."""
    if shape.frame is None:
        return state
    (q, e, s), frame = np.asarray(state.lengths), np.array(shape.frame)
    courses, wales = (np.array([[q, s], [0.0, e]]) @ frame).T
    x = courses / np.linalg.norm(courses)
    turn = np.array([x, [-x[1], x[0]]])
    nodes, wales = np.asarray(state.positions), turn @ wales
    turned = np.concatenate([nodes[..., :2] @ turn.T, nodes[..., 2:]], axis=-1)
    return Configuration(turned, np.array([np.linalg.norm(courses), wales[1], wales[0]]))
