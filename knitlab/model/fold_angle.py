"""The angle of a fold: between the normals of the two cells that share an edge.

A cell is not plane. Its normal, the cross product of its diagonals, may therefore have a component
along the edge. The paper does not state how this component is treated; the model option
:attr:`~knitlab.model.options.ModelOptions.fold_angle` does.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.model.options import FoldAngle

Vector = Float[Array, "3 *element"]
AngleAndSlope = tuple[Float[Array, " *element"], tuple[Vector, Vector, Vector]]
"""A fold angle, and its derivatives with respect to the edge and to the normals beside it."""


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def fold_from_rest(
    vectors: Float[Array, "5 3 *element"], rest: Float[Array, " *element"], of: FoldAngle
) -> Float[Array, " *element"]:
    """Signed fold angle of hinges minus its rest value, on the branch nearest zero [rad].

    The fold angle is that between the normals of the two cells about their shared edge, positive
    for a mountain; a normal is the cross product of its cell's diagonals. On this
    branch the energy is smooth unless the angle differs from its rest value by exactly π.

    Args:
        vectors: the edge and the two diagonals of each cell,
            see :data:`~knitlab.model.network.HINGE_VECTORS`.
        rest: signed fold angle at rest.
        of: the definition of the fold angle, a model option.
    """
    return _fold_and_slope(vectors, rest, of)[0]


_cross = partial(jnp.cross, axis=0)


def _fold_and_slope(
    vectors: Float[Array, "5 3 *element"], rest: Float[Array, " *element"], of: FoldAngle
) -> tuple[Float[Array, " *element"], Float[Array, "5 3 *element"]]:
    """The fold angle minus its rest value, and its derivative with respect to the vectors."""
    edge, *diagonals = vectors
    before = _cross(diagonals[0], diagonals[1])
    after = _cross(diagonals[2], diagonals[3])
    angle, (by_edge, by_before, by_after) = _ANGLE[of](edge, before, after)
    angle -= rest
    angle -= 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))
    slope = [
        by_edge,
        _cross(diagonals[1], by_before),
        _cross(by_before, diagonals[0]),
        _cross(diagonals[3], by_after),
        _cross(by_after, diagonals[2]),
    ]
    return angle, jnp.stack(slope)


def _between_whole_normals(edge: Vector, before: Vector, after: Vector) -> AngleAndSlope:
    """φ = atan2(S, C) with S = (n1 × n2)·ê and C = n1·n2.

    With r² = S² + C² its slopes are φ_S = C/r² and φ_C = −S/r².
    """
    length = jnp.linalg.norm(edge, axis=0)
    along = edge / length
    turned = _cross(before, after)
    sine, cosine = (turned * along).sum(0), (before * after).sum(0)
    by_sine, by_cosine = jnp.array([cosine, -sine]) / (sine**2 + cosine**2)
    return jnp.arctan2(sine, cosine), (
        by_sine * (turned - sine * along) / length,
        by_sine * _cross(after, along) + by_cosine * after,
        by_sine * _cross(along, before) + by_cosine * before,
    )


def _across_edge(edge: Vector, before: Vector, after: Vector) -> AngleAndSlope:
    """The same with m = n − p ê, p = n·ê, instead of n.

    A normal turns about the edge, and φ with it, by t = ê × m/|m|² for each unit of n, and by
    −(p/ℓ) t for each unit that the edge ℓ ê itself turns.
    """
    length = jnp.linalg.norm(edge, axis=0)
    along = edge / length
    component_before, component_after = (before * along).sum(0), (after * along).sum(0)
    before, after = before - component_before * along, after - component_after * along
    sine, cosine = (_cross(before, after) * along).sum(0), (before * after).sum(0)
    by_before = _cross(before, along) / (before**2).sum(0)
    by_after = _cross(along, after) / (after**2).sum(0)
    by_edge = -(component_before * by_before + component_after * by_after) / length
    return jnp.arctan2(sine, cosine), (by_edge, by_before, by_after)


_ANGLE = {"whole_normals": _between_whole_normals, "across_edge": _across_edge}


@fold_from_rest.defjvp
def _fold_from_rest_slope(
    of: FoldAngle, primals: tuple[Array, Array], tangents: tuple[Array, Array]
) -> tuple[Array, Array]:
    # With the derivative in closed form the gradient of the energy takes half the time.
    angle, slope = _fold_and_slope(*primals, of)
    return angle, (slope * tangents[0]).sum((0, 1)) - tangents[1]
