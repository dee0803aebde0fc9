"""Alignment: the rotation that best maps one set of points onto another, differentiable."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float


def aligning_rotation(
    target: Float[Array, "point 3"], points: Float[Array, "point 3"]
) -> Float[Array, "3 3"]:
    """The rotation R that minimises Σ ‖R x − y‖² (Kabsch, Acta Cryst. A 32, 922, 1976).

    It and its first derivative exist where the best rotation is unique, so not for collinear
    points.

    Args:
        target: target positions y.
        points: positions x, which are rotated about the origin.
    """
    covariance = target.T @ points
    left, _, right = jnp.linalg.svd(lax.stop_gradient(covariance))
    handed = jnp.sign(jnp.linalg.det(left @ right))
    rotation = (left * jnp.array([1.0, 1.0, handed])) @ right
    # Singular vectors are not differentiable where two singular values coincide, but the rotation
    # is: one Newton step for a small rotation vector, whose value is 0, carries its derivative.
    turned = rotation @ covariance.T
    unbalanced = _axial(turned - turned.T)
    curvature = jnp.trace(turned) * jnp.eye(3) - (turned + turned.T) / 2
    return rotation + _cross(jnp.linalg.solve(curvature, unbalanced)) @ rotation


def _axial(skew: Float[Array, "3 3"]) -> Float[Array, "3"]:
    return jnp.stack([skew[1, 2], skew[2, 0], skew[0, 1]])


def _cross(vector: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The matrix of the cross product by a vector."""
    x, y, z = vector
    return jnp.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
