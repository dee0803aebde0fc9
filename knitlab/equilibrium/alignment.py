"""Alignment: the rotation that best maps one set of points onto another, differentiable."""

import numpy as np
from jax import lax
from jaxtyping import Array, Float

from knitlab.fabric.array_library import array_library

Vector = Float[Array | np.ndarray, "3"]
Rotation = Float[Array | np.ndarray, "3 3"]


def aligning_rotation(
    target: Float[Array | np.ndarray, "point 3"], points: Float[Array | np.ndarray, "point 3"]
) -> Rotation:
    """The rotation R that minimises Σ ‖R x − y‖² (Kabsch, Acta Cryst. A 32, 922, 1976).

    It and its first derivative exist where the best rotation is unique, so not for collinear
    points.

    Args:
        target: target positions y.
        points: positions x, which are rotated about the origin.
    """
    xp, covariance = array_library(target, points), target.T @ points
    constant = covariance if xp is np else lax.stop_gradient(covariance)
    left, _, right = xp.linalg.svd(constant)
    handed = xp.sign(xp.linalg.det(left @ right))
    rotation = (left * xp.array([1.0, 1.0, handed])) @ right
    # Singular vectors are not differentiable where two singular values coincide, but the rotation
    # is: one Newton step for a small rotation vector, whose value is 0, carries its derivative.
    turned = rotation @ covariance.T
    unbalanced = _axial(turned - turned.T)
    curvature = xp.trace(turned) * np.eye(3) - (turned + turned.T) / 2
    return rotation + _cross(xp.linalg.solve(curvature, unbalanced)) @ rotation


def _axial(skew: Rotation) -> Vector:
    return array_library(skew).stack([skew[1, 2], skew[2, 0], skew[0, 1]])


def _cross(vector: Vector) -> Rotation:
    """The matrix of the cross product by a vector."""
    x, y, z = vector
    return array_library(vector).array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
