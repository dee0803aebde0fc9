"""How a relaxed sample is laid between clamps and walls: rigid motions of a free sample."""

import numpy as np
from jax import lax
from jaxtyping import Array, Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from knitlab.model.array_library import array_library
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.load import Load


def rigidly_aligned(
    shape: MeshShape, flat: Configuration, relaxed: Configuration, load: Load = WARP
) -> Configuration:
    """A relaxed sample rotated so that the nodes to be clamped match its flat sheet best.

    A free sample rotates, tilts and drifts as it folds. Its height between the walls is kept.
    """
    if shape.periodic:
        return relaxed
    clamped = load.clamped_nodes(shape)
    held, flat_held = (sheet.positions[clamped] for sheet in (relaxed, flat))
    middle = held.mean(axis=0)
    turn = aligning_rotation(flat_held - flat_held.mean(axis=0), held - middle)
    nodes = middle + (relaxed.positions.reshape(-1, 3) - middle) @ turn.T
    apart = flat.positions.reshape(-1, 3) - nodes
    drift = (apart if shape.spans is None else apart[shape.nodes_of_fabric.ravel()]).mean(axis=0)
    level = (nodes + drift * np.array([1, 1, 0])).reshape(relaxed.positions.shape)
    if shape.spans is not None:
        # Nodes without fabric stay between the walls.
        xp = array_library(level)
        level = xp.where(shape.nodes_of_fabric[..., None], level, flat.positions)
    return Configuration(level, relaxed.lengths)


def aligning_rotation(
    target: Float[Array | np.ndarray, "point 3"], points: Float[Array | np.ndarray, "point 3"]
) -> Float[Array | np.ndarray, "3 3"]:
    """The unique rotation R that minimises Σ ‖R x − y‖² (Kabsch, Acta Cryst. A 32, 922, 1976)."""
    xp = array_library(target, points)
    covariance = target.T @ points
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


def between_walls(shape: MeshShape, configuration: Configuration, z_max: float) -> Configuration:
    """A sample tilted and lifted rigidly so that it penetrates the walls at ± z_max least [mm]."""
    positions = np.array(configuration.positions)
    nodes = positions[shape.nodes_of_fabric]
    middle = nodes.mean(axis=0)

    def moved(move: Float[np.ndarray, "3"]) -> Float[np.ndarray, "node 3"]:
        tilt = Rotation.from_rotvec([move[0], move[1], 0.0])
        return middle + tilt.apply(nodes - middle) + np.array([0.0, 0.0, move[2]])

    def excess(move: Float[np.ndarray, "3"]) -> Float[np.ndarray, " node"]:
        return np.maximum(np.abs(moved(move)[:, 2]) - z_max, 0.0)

    least = least_squares(excess, np.zeros(3), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    positions[shape.nodes_of_fabric] = moved(least.x)
    return Configuration(positions, np.asarray(configuration.lengths))
