"""The angle of a fold: between the normals of the two cells that share an edge.

A cell is not plane: its normal, the cross product of its diagonals, may have a component along the
edge. How that is treated is an option (:attr:`~knitlab.model.settings.ModelOptions.fold_angle`).
"""

from collections.abc import Sequence
from functools import partial

import jax
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.array_library import array_library
from knitlab.model.settings import FoldAngle

Each = Float[Array | np.ndarray, " *element"]  # A value of every element
HingeVectors = Float[Array | np.ndarray, "5 3 *element"]
"""The edge of every hinge and its diagonals, see :data:`~knitlab.model.network.HINGE_VECTORS`."""
Vector = Float[Array | np.ndarray, "3 *element"]
AngleAndSlopes = tuple[Each, tuple[Vector, Vector, Vector]]
"""A fold angle, and its derivatives with respect to the edge and to the normals beside it."""


@partial(jax.custom_jvp, nondiff_argnums=(2,))
def fold_from_rest(vectors: HingeVectors, rest: Each, of: FoldAngle) -> Each:
    """Signed fold angle, > 0 in a mountain, minus its rest value, between ±π [rad]."""
    return fold_and_slope(vectors, rest, of)[0]


def fold_and_slope(vectors: HingeVectors, rest: Each, of: FoldAngle) -> tuple[Each, HingeVectors]:
    """The result of :func:`fold_from_rest`, and its derivative with respect to the vectors."""
    xp = array_library(vectors)
    edge, *diagonals = vectors
    before = xp.cross(diagonals[0], diagonals[1], axis=0)
    after = xp.cross(diagonals[2], diagonals[3], axis=0)
    angle, slopes = fold_from_normals(edge, before, after, rest, of)
    return angle, hinge_vector_slopes(slopes, diagonals)


def fold_from_normals(
    edge: Vector, before: Vector, after: Vector, rest: Each, of: FoldAngle
) -> AngleAndSlopes:
    """The fold angle minus its rest value, from the edge and the normals beside it."""
    xp = array_library(edge)
    angle, slopes = _ANGLE[of](edge, before, after)
    angle = angle - rest
    return angle - 2 * np.pi * xp.round(angle / (2 * np.pi)), slopes


def hinge_vector_slopes(
    slopes: Array | Sequence[Float[Array | np.ndarray, "3 ..."]],
    diagonals: Array | Sequence[Vector],
) -> Float[Array | np.ndarray, "5 3 ..."]:
    """Derivatives with respect to a hinge's vectors, from those by its edge and two normals."""
    xp = array_library(slopes)
    by_edge, by_before, by_after = slopes
    others = (1,) * (by_edge.ndim - diagonals[0].ndim)
    one, two, three, four = (each.reshape(3, *others, *each.shape[1:]) for each in diagonals)
    beside = (two, by_before), (by_before, one), (four, by_after), (by_after, three)
    return xp.stack([by_edge, *(xp.cross(*pair, axis=0) for pair in beside)])


def _between_whole_normals(edge: Vector, before: Vector, after: Vector) -> AngleAndSlopes:
    """φ = atan2(S, C), S = (n1 × n2)·ê, C = n1·n2; φ_S = C/r², φ_C = −S/r², r² = S² + C²."""
    xp = array_library(edge)
    cross = partial(xp.cross, axis=0)
    length = xp.linalg.norm(edge, axis=0)
    along = edge / length
    turned = cross(before, after)
    sine = (turned * along).sum(0)
    cosine = (before * after).sum(0)
    by_sine, by_cosine = xp.stack([cosine, -sine]) / (sine**2 + cosine**2)
    return xp.arctan2(sine, cosine), (
        by_sine * (turned - sine * along) / length,
        by_sine * cross(after, along) + by_cosine * after,
        by_sine * cross(along, before) + by_cosine * before,
    )


def _across_edge(edge: Vector, before: Vector, after: Vector) -> AngleAndSlopes:
    """The same with m = n − p ê, p = n·ê: φ turns by t = ê × m/|m|² with n, −(p/ℓ) t with ℓ ê."""
    xp = array_library(edge)
    cross = partial(xp.cross, axis=0)
    length = xp.linalg.norm(edge, axis=0)
    along = edge / length
    component_before = (before * along).sum(0)
    component_after = (after * along).sum(0)
    before = before - component_before * along
    after = after - component_after * along
    sine = (cross(before, after) * along).sum(0)
    cosine = (before * after).sum(0)
    by_before = cross(before, along) / (before**2).sum(0)
    by_after = cross(along, after) / (after**2).sum(0)
    by_edge = -(component_before * by_before + component_after * by_after) / length
    return xp.arctan2(sine, cosine), (by_edge, by_before, by_after)


_ANGLE = {"whole_normals": _between_whole_normals, "across_edge": _across_edge}


@fold_from_rest.defjvp
def _fold_from_rest_slope(
    of: FoldAngle, primals: tuple[Array, Array], tangents: tuple[Array, Array]
) -> tuple[Array | np.ndarray, Array | np.ndarray]:
    # With the derivative in closed form the gradient of the energy takes half the time.
    angle, slope = fold_and_slope(*primals, of)
    return angle, (slope * tangents[0]).sum((0, 1)) - tangents[1]
