"""Loadings: which unknowns are free, and how the held ones move with the applied strain."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from knitlab.model.network import MeshShape


@dataclass(frozen=True, eq=False)
class Loading:
    """A displacement-controlled test along y, from a reference configuration.

    Attributes:
        unknowns: places of the free unknowns.
        reference: the relaxed configuration [mm].
        drive: how far each unknown moves per unit of applied strain where it is held, and in an
            affine stretch where it is free [mm].
        length: the length that the applied strain refers to [mm].
    """

    unknowns: Int[np.ndarray, " free"]
    reference: Float[np.ndarray, " unknown"]
    drive: Float[np.ndarray, " unknown"]
    length: float

    @property
    def held(self) -> Int[np.ndarray, " held"]:
        """Places of the held unknowns."""
        return np.setdiff1d(np.arange(len(self.reference)), self.unknowns)

    def holding(
        self, configuration: Float[np.ndarray, " unknown"], applied_strain: float
    ) -> Float[np.ndarray, " unknown"]:
        """The configuration with its held unknowns where the applied strain puts them [mm]."""
        held, moved = self.held, configuration.copy()
        moved[held] = self.reference[held] + applied_strain * self.drive[held]
        return moved

    def reaction_force(self, gradient: Float[np.ndarray, " unknown"]) -> float:
        """Force that drives the test, conjugate to the displacement of its driven end [N].

        It is ∂V/∂(displacement) at fixed free unknowns: for a clamped sample the sum of the y
        forces on the top row, for endless fabric ∂V/∂L_y.
        """
        held = self.held
        return float(self.drive[held] @ gradient[held] / self.length)


def all_free(shape: MeshShape) -> Int[np.ndarray, " free"]:
    """Free unknowns while a fabric relaxes: every coordinate, and the lengths if endless."""
    return np.arange(shape.unknowns if shape.periodic else 3 * shape.nodes)


def squaring_angle(
    shape: MeshShape,
    flat: Float[np.ndarray, " unknown"],
    relaxed: Float[np.ndarray, " unknown"],
) -> float:
    """How far a relaxed sample must be turned in its plane to lie as its flat sheet did [rad].

    A free sample may turn as it folds, by an angle that hangs on how it came there; one squares
    it up before it is clamped, for pulled askew it takes other states. Endless fabric cannot turn.
    """
    if shape.periodic:
        return 0.0
    (x, y), (flat_x, flat_y) = (_about_middle(of).T for of in (relaxed, flat))
    return float(np.arctan2(np.sum(x * flat_y - y * flat_x), np.sum(x * flat_x + y * flat_y)))


def turned(vector: Float[np.ndarray, " unknown"], angle: float) -> Float[np.ndarray, " unknown"]:
    """A configuration, or the forces on it, turned in the plane about the middle of its nodes."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    nodes = vector[:-2].reshape(-1, 3).copy()
    from_middle = _about_middle(vector)
    nodes[:, :2] += from_middle @ turn - from_middle
    return np.concatenate([nodes.ravel(), vector[-2:]])


def _about_middle(vector: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "node 2"]:
    in_plane = vector[:-2].reshape(-1, 3)[:, :2]
    return in_plane - in_plane.mean(axis=0)


def tensile(shape: MeshShape, relaxed: Float[np.ndarray, " unknown"]) -> Loading:
    """The paper's tensile test on a relaxed shape (Sec. "Kinematics under tension").

    A clamped sample has its bottom row held and its top row displaced along y; the applied
    strain is that displacement over the relaxed distance between the rows. Endless fabric has
    L_y prescribed and L_x free; the applied strain is the relative change of L_y.
    """
    drive = np.zeros(shape.unknowns)
    heights = relaxed[1:-2:3]
    if shape.periodic:
        length = float(relaxed[-1])
        drive[1:-2:3], drive[-1] = heights, length
        return Loading(np.arange(shape.unknowns - 1), relaxed, drive, length)
    rows = heights.reshape(shape.nodes_y, shape.nodes_x)
    length = float(rows[-1].mean() - rows[0].mean())
    affine = np.clip(rows - rows[0].mean(), 0, length)
    affine[0], affine[-1] = 0, length
    drive[1:-2:3] = affine.ravel()
    inner = np.arange(3 * shape.nodes_x, 3 * (shape.nodes - shape.nodes_x))
    return Loading(inner, relaxed, drive, length)
