"""Second derivatives of the energies of elements: of springs and hinges in closed form.

Automatic differentiation gives the same values (tests compare them) at five times the cost.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.energy import wall_energy
from knitlab.model.network import HINGE_VECTORS
from knitlab.model.options import FoldAngle
from knitlab.model.spring_law import LINEAR, SpringLaw

Vector = Float[Array, "3 element"]
Matrix = Float[Array, "3 3 element"]
ByEdgeAndNormals = tuple[tuple[Vector, Vector], list[list[Matrix]]]
"""Gradient with respect to the two normals, and Hessian for edge and normals, lower triangle."""

LANES = 64
"""Number of hinges in a block, so that their intermediate values stay in the fastest cache."""

SPRING_ENTRIES = np.tril_indices(3)
"""Rows and columns of the entries of a spring's stiffness that are kept."""

HINGE_ENTRIES = np.tril_indices(18)
"""Rows and columns (3 × node + component) of the entries of a hinge's stiffness that are kept."""

UNFOLDED = np.array([[0, 1, 0], [1, 1, 0], [-1, 1, 0], [1, 1, 0], [-1, 1, 0]])[:, :, None] * 1.0
"""Vectors of a flat hinge, for padding: any that is not degenerate."""


def spring_stiffness(
    vectors: Float[Array, "3 spring"],
    rest_length: Float[Array, " spring"],
    stiffness: Float[Array, " spring"],
    law: SpringLaw = LINEAR,
) -> Float[Array, "6 spring"]:
    """Hessian of the energy of springs with respect to their vectors, lower triangle [N/mm].

    For a linear spring it is k_s along the spring, and tension over length, k_s (1 − ℓ0/ℓ), across
    it.
    """
    length = jnp.sqrt((vectors**2).sum(0))
    along = vectors / length
    stretching = stiffness * law.slope(length, rest_length)
    across = stiffness * law.pull_over_length(length, rest_length)
    hessian = (stretching - across) * _outer(along, along) + across * jnp.eye(3)[:, :, None]
    return hessian[SPRING_ENTRIES]


def hinge_stiffness(
    vectors: Float[Array, "5 3 hinge"],
    rest: Float[Array, " hinge"],
    stiffness: Float[Array, " hinge"],
    of: FoldAngle,
) -> Float[Array, "block 171 lane"]:
    """Hessian of ½ k_t (φ − φ0)² with respect to the hinge's six nodes, lower triangle [N/mm].

    Args:
        vectors: see :data:`~knitlab.model.network.HINGE_VECTORS`.
        rest: signed fold angle at rest, φ0.
        stiffness: k_t.
        of: definition of the fold angle, a model option.

    Returns:
        The entries of :data:`HINGE_ENTRIES`, for blocks of :data:`LANES` hinges; the last block
        is padded with hinges of no stiffness.
    """
    blocks = -(-len(rest) // LANES)
    spare = (0, blocks * LANES - len(rest))
    filled = jnp.concatenate([vectors, jnp.broadcast_to(UNFOLDED, (5, 3, spare[1]))], axis=-1)
    hinges = (
        jnp.moveaxis(filled.reshape(5, 3, blocks, LANES), 2, 0),
        jnp.pad(rest, spare).reshape(blocks, LANES),
        jnp.pad(stiffness, spare).reshape(blocks, LANES),
    )
    return jax.lax.map(lambda block: _hinge_entries(block[0], block[1], block[2], of), hinges)


def wall_stiffness(
    heights: Float[Array, " node"],
    z_max: Float[Array, "*#node"],
    k_wall: Float[Array, "*#node"],
) -> Float[Array, " node"]:
    """Second derivative of the wall penalty with respect to the height of every node [N/mm]."""
    walls = (jnp.broadcast_to(number, heights.shape) for number in (z_max, k_wall))
    return jax.vmap(jax.grad(jax.grad(wall_energy)))(heights, *walls)


def _hinge_entries(
    vectors: Float[Array, "5 3 lane"],
    rest: Float[Array, " lane"],
    stiffness: Float[Array, " lane"],
    of: FoldAngle,
) -> Float[Array, "171 lane"]:
    """Derivatives with respect to nodes: every node is the start or the end of some vectors."""
    by_vectors = _by_vectors(vectors, rest, stiffness, of)
    blocks = {}
    for row in range(6):
        for column in range(row + 1):
            terms = [
                int(HINGE_VECTORS[i, row] * HINGE_VECTORS[j, column]) * by_vectors[i][j]
                for i in range(5)
                for j in range(5)
                if HINGE_VECTORS[i, row] * HINGE_VECTORS[j, column]
            ]
            blocks[row, column] = sum(terms[1:], terms[0])
    return jnp.stack(
        [
            blocks[i // 3, j // 3][i % 3, j % 3]
            for i, j in zip(*(of.tolist() for of in HINGE_ENTRIES), strict=True)
        ]
    )


def _by_vectors(
    vectors: Float[Array, "5 3 lane"],
    rest: Float[Array, " lane"],
    stiffness: Float[Array, " lane"],
    of: FoldAngle,
) -> list[list[Matrix]]:
    """Derivatives with respect to the edge and the diagonals; normals are their cross products."""
    edge, *diagonals = vectors
    before = jnp.cross(diagonals[0], diagonals[1], axis=0)
    after = jnp.cross(diagonals[2], diagonals[3], axis=0)
    by_edge_and_normals = _BY_EDGE_AND_NORMALS[of]
    (by_before, by_after), second = by_edge_and_normals(edge, before, after, rest, stiffness)
    # n = d × d′ has ∂n/∂d = −[d′]× and ∂n/∂d′ = [d]×.
    normal = [1, 1, 2, 2]
    slope = [
        -_skew(diagonals[1]),
        _skew(diagonals[0]),
        -_skew(diagonals[3]),
        _skew(diagonals[2]),
    ]
    rows: list[list[Matrix]] = [[second[0][0]] for _ in range(5)]
    for i in range(4):
        rows[i + 1][0] = _product(_turned(slope[i]), second[normal[i]][0])
        for j in range(i + 1):
            half = _product(_turned(slope[i]), second[normal[i]][normal[j]])
            rows[i + 1].append(_product(half, slope[j]))
    rows[2][1] += _skew(by_before)
    rows[4][3] += _skew(by_after)
    return [[rows[i][j] if j <= i else _turned(rows[j][i]) for j in range(5)] for i in range(5)]


def _of_whole_normals(
    edge: Vector, before: Vector, after: Vector, rest: Array, stiffness: Array
) -> ByEdgeAndNormals:
    """Gradient and Hessian where φ is the angle between whole normals.

    φ = atan2(S, C) with S = (n1 × n2)·ê and C = n1·n2, so that with r² = S² + C²:
    φ_S = C/r², φ_C = −S/r², φ_SS = −φ_CC = −2SC/r⁴, φ_SC = (S² − C²)/r⁴.
    """
    length = jnp.sqrt((edge**2).sum(0))
    along = edge / length
    turned = jnp.cross(before, after, axis=0)
    sine, cosine = (turned * along).sum(0), (before * after).sum(0)
    moment = _moment(sine, cosine, rest, stiffness)
    square = sine**2 + cosine**2
    by_sine, by_cosine = cosine / square, -sine / square
    bend, twist = -2 * sine * cosine / square**2, (sine**2 - cosine**2) / square**2
    ss = stiffness * by_sine**2 + moment * bend
    sc = stiffness * by_sine * by_cosine + moment * twist
    cc = stiffness * by_cosine**2 - moment * bend
    of_sine, of_cosine = moment * by_sine, moment * by_cosine

    sideways = (turned - along * sine) / length
    none = jnp.zeros_like(edge)
    slopes_s = sideways, jnp.cross(after, along, axis=0), jnp.cross(along, before, axis=0)
    slopes_c = none, after, before

    def squares(i: int, j: int) -> Matrix:
        right = ss * slopes_s[j] + sc * slopes_c[j]
        low = sc * slopes_s[j] + cc * slopes_c[j]
        return _outer(slopes_s[i], right) + _outer(slopes_c[i], low)

    across = (jnp.eye(3)[:, :, None] - _outer(along, along)) / length
    bent = _outer(along, sideways) + _outer(sideways, along)
    edge_edge = squares(0, 0) - of_sine / length * (bent + sine * across)
    before_edge = squares(1, 0) + of_sine * _product(_skew(after), across)
    after_edge = squares(2, 0) - of_sine * _product(_skew(before), across)
    mixed = squares(2, 1) + of_sine * _skew(along) + of_cosine * jnp.eye(3)[:, :, None]
    gradient = (
        of_sine * slopes_s[1] + of_cosine * slopes_c[1],
        of_sine * slopes_s[2] + of_cosine * slopes_c[2],
    )
    return gradient, [
        [edge_edge],
        [before_edge, squares(1, 1)],
        [after_edge, mixed, squares(2, 2)],
    ]


def _of_parts_across_edge(
    edge: Vector, before: Vector, after: Vector, rest: Array, stiffness: Array
) -> ByEdgeAndNormals:
    """Gradient and Hessian where φ is the rotation of the second normal minus that of the first.

    No second derivative of φ mixes the normals.
    """
    length = jnp.sqrt((edge**2).sum(0))
    along = edge / length
    component_1, component_2 = (before * along).sum(0), (after * along).sum(0)
    sine = (jnp.cross(before, after, axis=0) * along).sum(0)
    cosine = (before * after).sum(0) - component_1 * component_2
    moment = _moment(sine, cosine, rest, stiffness)

    slopes_1, bends_1 = _turn(before, component_1, along, length)
    slopes_2, bends_2 = _turn(after, component_2, along, length)
    slopes = slopes_2[0] - slopes_1[0], -slopes_1[1], slopes_2[1]

    def squares(i: int, j: int) -> Matrix:
        return _outer(stiffness * slopes[i], slopes[j])

    return (moment * slopes[1], moment * slopes[2]), [
        [squares(0, 0) + moment * (bends_2[0] - bends_1[0])],
        [squares(1, 0) - moment * bends_1[1], squares(1, 1) - moment * bends_1[2]],
        [squares(2, 0) + moment * bends_2[1], squares(2, 1), squares(2, 2) + moment * bends_2[2]],
    ]


def _turn(
    normal: Vector, component: Array, along: Vector, length: Array
) -> tuple[tuple[Vector, Vector], tuple[Matrix, Matrix, Matrix]]:
    """First and second derivatives of a normal's rotation α about the edge, by edge and by normal.

    With p = n·ê, m = n − p ê and t = ê × m/|m|² they are α_n = t, α_e = −(p/ℓ) t,
    α_nn = −(m tᵀ + t mᵀ)/|m|², α_ne = −((p/ℓ) α_nn + ê tᵀ/ℓ) and, except for a part that is
    the same for every normal, α_ee = ((p² + |m|²/2) α_nn + p (t êᵀ + ê tᵀ))/ℓ².
    """
    across = normal - component * along
    square = (across**2).sum(0)
    turn = jnp.cross(along, across, axis=0) / square
    twist = _outer(across, turn)
    by_normal = -(twist + _turned(twist)) / square
    lever = component / length
    aside = _outer(along, turn) / length
    by_edge = (lever**2 + square / (2 * length**2)) * by_normal + lever * (aside + _turned(aside))
    return (-lever * turn, turn), (by_edge, -(lever * by_normal + aside), by_normal)


_BY_EDGE_AND_NORMALS = {
    "whole_normals": _of_whole_normals,
    "across_edge": _of_parts_across_edge,
}


def _moment(sine: Array, cosine: Array, rest: Array, stiffness: Array) -> Array:
    """k_t (φ − φ0) of φ = atan2(sine, cosine), on the branch nearest φ0."""
    cos_rest, sin_rest = jnp.cos(rest), jnp.sin(rest)
    return stiffness * jnp.arctan2(
        sine * cos_rest - cosine * sin_rest, cosine * cos_rest + sine * sin_rest
    )


def _skew(vector: Vector) -> Matrix:
    """The matrix of the cross product, [v]× w = v × w."""
    x, y, z = vector
    none = jnp.zeros_like(x)
    return jnp.stack([none, -z, y, z, none, -x, -y, x, none]).reshape(3, 3, -1)


def _outer(left: Vector, right: Vector) -> Matrix:
    return left[:, None] * right[None, :]


def _product(left: Matrix, right: Matrix) -> Matrix:
    return (left[:, :, None] * right[None, :, :]).sum(1)


def _turned(matrix: Matrix) -> Matrix:
    return jnp.swapaxes(matrix, 0, 1)
