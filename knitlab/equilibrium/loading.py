"""Loadings: the free unknowns, the motion of the held ones, and how a sample is laid in a test."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from knitlab.fabric.array_library import array_library
from knitlab.fabric.fabric import Configuration
from knitlab.fabric.network import MeshShape

Unknowns = Float[Array | np.ndarray, " unknown"]
Points = Float[Array | np.ndarray, "point 3"]


@dataclass(frozen=True, eq=False)
class Loading:
    """A displacement-controlled test along y, from a relaxed configuration."""

    shape: MeshShape
    reference: Unknowns  # the relaxed configuration, flattened [mm]
    drive: Unknowns  # per unit of strain: prescribed if held, else of an affine stretch [mm]
    length: Float[Array, ""] | float  # that the applied strain refers to [mm]

    @property
    def free(self) -> Int[np.ndarray, " free"]:
        """Indices of the free unknowns."""
        return free_under_tension(self.shape)

    def holding(
        self, unknowns: Float[np.ndarray, " unknown"], applied_strain: float
    ) -> Float[np.ndarray, " unknown"]:
        """The unknowns, with the held ones set as the applied strain prescribes [mm]."""
        held, moved = held_under_tension(self.shape), unknowns.copy()
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

    def reaction_force(self, gradient: Unknowns) -> Float[Array, ""]:
        """Force on the driven end: Σ of y forces on the top row, or ∂V/∂L_y if periodic [N]."""
        held = held_under_tension(self.shape)
        return self.drive[held] @ gradient[held] / self.length


def all_free(shape: MeshShape) -> Int[np.ndarray, " free"]:
    """Free unknowns while a fabric relaxes: every coordinate, and the lengths if periodic."""
    return np.arange(shape.unknowns if shape.periodic else 3 * shape.nodes)


def free_under_tension(shape: MeshShape) -> Int[np.ndarray, " free"]:
    """Free unknowns of the tensile test: all but L_y if periodic, else those between the clamps."""
    if shape.periodic:
        return np.arange(shape.unknowns - 1)
    return np.arange(3 * shape.nodes_x, 3 * (shape.nodes - shape.nodes_x))


@lru_cache(maxsize=16)
def held_under_tension(shape: MeshShape) -> Int[np.ndarray, " held"]:
    """Held unknowns of the tensile test, L_x and L_y of an open sample among them."""
    return np.setdiff1d(np.arange(shape.unknowns), free_under_tension(shape))


def tensile(shape: MeshShape, relaxed: Configuration) -> Loading:
    """The paper's tensile test on a relaxed shape (Sec. "Kinematics under tension").

    A clamped sample has its bottom row held and its top row displaced along y, by the applied
    strain times their relaxed distance. Periodic fabric has L_y prescribed and L_x free. Made from
    JAX arrays, the loading is differentiable by the relaxed shape.
    """
    xp, rows = array_library(relaxed), relaxed.positions[..., 1]
    if shape.periodic:
        length = relaxed.lengths[1]
        moved, grown = rows, xp.stack([np.zeros(()), length])
    else:
        length = rows[-1].mean() - rows[0].mean()
        inner = xp.clip(rows[1:-1] - rows[0].mean(), 0, length)
        ends = np.zeros((1, shape.nodes_x))
        moved, grown = xp.concatenate([ends, inner, ends + length]), np.zeros(2)
    still = np.zeros(rows.shape)
    drive = Configuration(xp.stack([still, moved, still], axis=-1), grown)
    return Loading(shape, relaxed.flattened(), drive.flattened(), length)


def rigidly_aligned(shape: MeshShape, flat: Configuration, relaxed: Configuration) -> Configuration:
    """A relaxed sample rotated so that the rows to be clamped match its flat sheet best.

    A free sample rotates, tilts and drifts as it folds, and a misaligned one takes other states.
    Walls are ignored, and its height between them is kept. Periodic fabric cannot rotate.
    """
    if shape.periodic:
        return relaxed
    rows, flat_rows = (
        sheet.positions[np.array([0, -1])].reshape(-1, 3) for sheet in (relaxed, flat)
    )
    middle = rows.mean(axis=0)
    turn = aligning_rotation(flat_rows - flat_rows.mean(axis=0), rows - middle)
    nodes = middle + (relaxed.positions.reshape(-1, 3) - middle) @ turn.T
    drift = (flat.positions.reshape(-1, 3) - nodes).mean(axis=0)
    level = nodes + drift * np.array([1, 1, 0])
    return Configuration(level.reshape(relaxed.positions.shape), relaxed.lengths)


def aligning_rotation(target: Points, points: Points) -> Float[Array | np.ndarray, "3 3"]:
    """The unique rotation R that minimises Σ ‖R x − y‖² (Kabsch, Acta Cryst. A 32, 922, 1976)."""
    xp, covariance = array_library(target, points), target.T @ points
    constant = covariance if xp is np else lax.stop_gradient(covariance)
    left, _, right = xp.linalg.svd(constant)
    handed = xp.sign(xp.linalg.det(left @ right))
    rotation = (left * xp.array([1.0, 1.0, handed])) @ right
    # Singular vectors are not differentiable where two singular values coincide, but the rotation
    # is: one Newton step for a small rotation vector, whose value is 0, carries its derivative.
    turned = rotation @ covariance.T
    skew = turned - turned.T
    unbalanced = xp.stack([skew[1, 2], skew[2, 0], skew[0, 1]])
    curvature = xp.trace(turned) * np.eye(3) - (turned + turned.T) / 2
    x, y, z = xp.linalg.solve(curvature, unbalanced)
    return rotation + xp.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation


def between_walls(configuration: Configuration, z_max: float) -> Configuration:
    """A sample tilted and lifted rigidly so that it penetrates the walls at ± z_max least [mm]."""
    nodes = np.asarray(configuration.positions).reshape(-1, 3)
    middle = nodes.mean(axis=0)

    def moved(move: Float[np.ndarray, "3"]) -> Float[np.ndarray, "node 3"]:
        tilt = Rotation.from_rotvec([move[0], move[1], 0.0])
        return middle + tilt.apply(nodes - middle) + np.array([0.0, 0.0, move[2]])

    def excess(move: Float[np.ndarray, "3"]) -> Float[np.ndarray, " node"]:
        return np.maximum(np.abs(moved(move)[:, 2]) - z_max, 0.0)

    least = least_squares(excess, np.zeros(3), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    positions = moved(least.x).reshape(configuration.positions.shape)
    return Configuration(positions, np.asarray(configuration.lengths))
