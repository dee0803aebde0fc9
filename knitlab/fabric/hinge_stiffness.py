"""Second derivatives of the energy of hinges with respect to their nodes, in closed form.

The energy depends on the edge e and on the normals n₁, n₂ beside it, which are cross products of
diagonals: with J their derivative with respect to the nodes, H the Hessian and g the gradient with
respect to them, the stiffness is Jᵀ H J + Σ g ∂²n.

Automatic differentiation gives the same values (tests compare them) at five times the cost. The
entries of J and of the second derivatives are constants, or components of diagonals up to a sign,
so that tables tell where each goes: XLA compiles a few operations on tables much faster than
hundreds on single blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.fabric.network import HINGE_VECTORS
from knitlab.fabric.options import FoldAngle

Vector = Float[Array, "3 lane"]
Matrix = Float[Array, "3 3 lane"]
Derivatives = tuple[Float[Array, "9 lane"], Float[Array, "9 9 lane"]]
"""Gradient and Hessian with respect to the edge and the two normals."""

LANES = 64
"""Number of hinges in a block, so that their intermediate values stay in the fastest cache."""

NODES = HINGE_VECTORS.shape[1]
UNKNOWNS = 3 * NODES
OF_EDGE = 3 * 2
"""Unknowns of the two nodes of the edge, which come first; they belong to both normals."""

HINGE_ENTRIES = np.tril_indices(UNKNOWNS)
"""Rows and columns (3 × node + component) of the entries of a hinge's stiffness that are kept."""

UNFOLDED = np.array([[0, 1, 0], [1, 1, 0], [-1, 1, 0], [1, 1, 0], [-1, 1, 0]])[:, :, None] * 1.0
"""Vectors of a flat hinge, for padding: any that is not degenerate."""


@dataclass(frozen=True, eq=False)
class Signed:
    """An array with entries that are 0 or, up to their sign, one of several values.

    Attributes:
        places: index of the value of every entry.
        signs: 1, -1, or 0.
    """

    places: Int[np.ndarray, "*entry"]
    signs: Float[np.ndarray, "*entry"]

    @classmethod
    def of(cls, factors: Float[np.ndarray, "*entry value"]) -> "Signed":
        """The array with the given factors of the values, of which one at most is not 0."""
        return cls(np.abs(factors).argmax(-1), factors.sum(-1))

    def __call__(self, values: Float[Array, "value lane"]) -> Float[Array, "*entry lane"]:
        """The entries, for given values."""
        return values[self.places] * self.signs[..., None]


LEVI_CIVITA = np.cross(np.eye(3)[:, None], np.eye(3))
"""Sign of every permutation of three axes."""

DIAGONALS = HINGE_VECTORS[1:].reshape(2, 2, NODES)
"""Where the two diagonals of each normal start (-1) and end (1)."""
OF_DIAGONALS = 3 * 4
"""Components of all diagonals."""


def _columns_by_nodes() -> list[list[tuple[Int[np.ndarray, " column"], Signed]]]:
    """Non-zeros of J for the nodes of the edge, and for all others: row and value of each column.

    Values are the components of the diagonals, and 1.
    """
    jacobian = np.zeros((3, 3, NODES, 3, OF_DIAGONALS + 1))
    jacobian[0, ..., OF_DIAGONALS] = np.einsum("n,ab->anb", HINGE_VECTORS[0], np.eye(3))
    of_diagonals = np.zeros((2, 3, NODES, 3, 2, 2, 3))
    for normal, (first, second) in enumerate(DIAGONALS):
        of_diagonals[normal, ..., normal, 1, :] = np.einsum("n,bca->anbc", first, LEVI_CIVITA)
        of_diagonals[normal, ..., normal, 0, :] = np.einsum("n,cba->anbc", second, LEVI_CIVITA)
    jacobian[1:, ..., :-1] = of_diagonals.reshape(2, 3, NODES, 3, OF_DIAGONALS)
    by_column = jacobian.reshape(9, UNKNOWNS, -1).transpose(1, 0, 2)
    groups = []
    for columns in by_column[:OF_EDGE], by_column[OF_EDGE:]:
        # Every column of a group has as many non-zeros.
        rows = np.array([np.flatnonzero(column.any(axis=1)) for column in columns])
        groups.append([(row, Signed.of(columns[np.arange(len(columns)), row])) for row in rows.T])
    return groups


def _second_by_nodes() -> list[Signed]:
    """Kept entries of Σ g ∂²n, for each normal; values are the components of its g."""
    first, second = DIAGONALS.swapaxes(0, 1)
    mixed = np.einsum("kn,km,bca->knbmca", first, second, LEVI_CIVITA)
    whole = mixed + mixed.transpose(0, 3, 4, 1, 2, 5)
    by_unknowns = whole.reshape(2, UNKNOWNS, UNKNOWNS, 3)
    return [Signed.of(of_normal[HINGE_ENTRIES]) for of_normal in by_unknowns]


ENDS, OTHERS = _columns_by_nodes()
"""J for the two nodes of the edge, and for the four others."""

NORMALS_TWICE = _second_by_nodes()
"""Second derivative of each normal by the nodes."""

PRODUCT_PLACES = np.where(
    HINGE_ENTRIES[0] < OF_EDGE,
    OF_EDGE * HINGE_ENTRIES[0] + HINGE_ENTRIES[1],
    OF_EDGE**2 + UNKNOWNS * (HINGE_ENTRIES[0] - OF_EDGE) + HINGE_ENTRIES[1],
)
"""Where the kept entries are among those of the edge's nodes by these, and of others by all."""

TRIPLE = Signed.of(np.einsum("ijk,abc->iajbkc", LEVI_CIVITA, LEVI_CIVITA).reshape(9, 9, 9))
"""Second derivative of the triple product of three vectors; values are their components."""

SCALAR = np.kron([[0, 0, 0], [0, 0, 1], [0, 1, 0]], np.eye(3))[:, :, None]
"""Second derivative of the scalar product of the second and third of three vectors."""


def hinge_stiffness(
    vectors: Float[Array | np.ndarray, "5 3 hinge"],
    rest: Float[Array | np.ndarray, " hinge"],
    stiffness: Float[Array | np.ndarray, " hinge"],
    of: FoldAngle,
) -> Float[Array, "block 171 lane"]:
    """Hessian of ½ k_t (φ − φ0)² with respect to the hinge's six nodes, lower triangle [N/mm].

    Args:
        vectors: see :data:`~knitlab.fabric.network.HINGE_VECTORS`.
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
    return jax.lax.map(lambda block: _entries(block[0], block[1], block[2], of), hinges)


def _entries(
    vectors: Float[Array, "5 3 lane"],
    rest: Float[Array, " lane"],
    stiffness: Float[Array, " lane"],
    of: FoldAngle,
) -> Float[Array, "171 lane"]:
    edge, diagonals = vectors[0], vectors[1:]
    before, after = jnp.cross(diagonals[::2], diagonals[1::2], axis=1)
    slope, hessian = _BY_EDGE_AND_NORMALS[of](edge, before, after, rest, stiffness)
    values = jnp.concatenate([diagonals.reshape(OF_DIAGONALS, -1), jnp.ones_like(edge[:1])])
    ends, others = ([(row, value(values)) for row, value in group] for group in (ENDS, OTHERS))
    half = jnp.concatenate(
        [_sum([hessian[:, row] * value for row, value in group]) for group in (ends, others)],
        axis=1,
    )
    products = jnp.concatenate(
        [
            _sum([half[row, :OF_EDGE] * value[:, None] for row, value in ends]).reshape(-1, LANES),
            _sum([half[row] * value[:, None] for row, value in others]).reshape(-1, LANES),
        ]
    )
    before_twice, after_twice = NORMALS_TWICE
    return products[PRODUCT_PLACES] + before_twice(slope[3:6]) + after_twice(slope[6:])


def _of_whole_normals(
    edge: Vector, before: Vector, after: Vector, rest: Array, stiffness: Array
) -> Derivatives:
    """Gradient and Hessian where φ is the angle between whole normals.

    φ = atan2(S, C) with S = (n1 × n2)·ê and C = n1·n2, so that with r² = S² + C²:
    φ_S = C/r², φ_C = −S/r², φ_SS = −φ_CC = −2SC/r⁴, φ_SC = (S² − C²)/r⁴. First the derivatives
    with respect to ê, which ∂ê/∂e = (1 − ê êᵀ)/ℓ turns into those with respect to the edge.
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

    of_s = jnp.concatenate(
        [turned, jnp.cross(after, along, axis=0), jnp.cross(along, before, axis=0)]
    )
    of_c = jnp.concatenate([jnp.zeros_like(edge), after, before])
    slope = of_sine * of_s + of_cosine * of_c
    hessian = _outer(of_s, ss * of_s + sc * of_c) + _outer(of_c, sc * of_s + cc * of_c)
    hessian += of_sine * TRIPLE(jnp.concatenate([along, before, after])) + of_cosine * SCALAR

    across = (jnp.eye(3)[:, :, None] - _outer(along, along)) / length
    by_edge = _applied(across, slope[:3])
    bent = _outer(along, by_edge) + _outer(by_edge, along) + (along * slope[:3]).sum(0) * across
    rows = jnp.concatenate([_product(across, hessian[:3]), hessian[3:]])
    edge_edge = _product(rows[:3, :3], across) - bent / length
    edge_normal, normal_edge = rows[:3, 3:], _product(rows[3:, :3], across)
    return jnp.concatenate([by_edge, slope[3:]]), jnp.concatenate(
        [
            jnp.concatenate([edge_edge, edge_normal], axis=1),
            jnp.concatenate([normal_edge, rows[3:, 3:]], axis=1),
        ]
    )


def _of_parts_across_edge(
    edge: Vector, before: Vector, after: Vector, rest: Array, stiffness: Array
) -> Derivatives:
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
    slopes = jnp.concatenate([slopes_2[0] - slopes_1[0], -slopes_1[1], slopes_2[1]])
    none = jnp.zeros_like(bends_1[0])
    bends = [
        [bends_2[0] - bends_1[0], -_transposed(bends_1[1]), _transposed(bends_2[1])],
        [-bends_1[1], -bends_1[2], none],
        [bends_2[1], none, bends_2[2]],
    ]
    bend = jnp.concatenate([jnp.concatenate(row, axis=1) for row in bends])
    return moment * slopes, _outer(stiffness * slopes, slopes) + moment * bend


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
    by_normal = -(twist + _transposed(twist)) / square
    lever = component / length
    aside = _outer(along, turn) / length
    by_edge = (lever**2 + square / (2 * length**2)) * by_normal
    by_edge += lever * (aside + _transposed(aside))
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


def _sum(terms: Sequence[Array]) -> Array:
    return reduce(add, terms)


def _outer(left: Float[Array, "row lane"], right: Float[Array, "column lane"]) -> Array:
    return left[:, None] * right[None, :]


def _applied(matrix: Matrix, vector: Vector) -> Vector:
    return (matrix * vector[None, :]).sum(1)


def _product(left: Float[Array, "row 3 lane"], right: Float[Array, "3 column lane"]) -> Array:
    return (left[:, :, None] * right[None, :, :]).sum(1)


def _transposed(matrix: Matrix) -> Matrix:
    return jnp.swapaxes(matrix, 0, 1)
