"""Potential of a uniformly charged triangle, in closed form (Wilton et al., IEEE T-AP 32, 1984).

Components come first and points last, as XLA compiles fast loops over long last axes.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

import knitlab.fabric  # noqa: F401  (float64)

SMALLEST = 1e-300
"""Keeps quotients finite where their factor is zero."""

Vector = list[Array]
"""Three components, each for all points."""


def triangle_potential(
    at: Float[Array, "3 *#point"],
    corners: Float[Array, "3 3 *#point"],
    apart: Float[Array, "*#point"] | float = 0.0,
) -> Float[Array, "..."]:
    """Integral of 1/r over a triangle, as seen from a point [mm].

    With the point at height d above the plane of the triangle, and each edge at distance t from
    the foot of the perpendicular, extending from l⁻ to l⁺,

        ∫ dA/r = Σ_edges t ln((R⁺ + l⁺)/(R⁻ + l⁻))
                 − |d| (atan(t l⁺/(R₀² + |d| R⁺)) − atan(t l⁻/(R₀² + |d| R⁻))).

    It also holds on the triangle and its edges. A triangle without area gives 0.

    Args:
        at: the points [mm].
        corners: the triangle for each point, by corner and component [mm].
        apart: square c² of a distance that r includes besides, as √(r² + c²). It is then also part
            of d, as the height above a plane is [mm²].
    """
    ends = [[corner[axis] - at[axis] for axis in range(3)] for corner in corners]
    edges = [[b - a for a, b in zip(ends[k], ends[(k + 1) % 3], strict=True)] for k in range(3)]
    normal = _unit(_cross(edges[0], edges[1]))
    distance = [jnp.sqrt(_dot(end, end) + apart) for end in ends]
    height = jnp.sqrt(_dot(ends[0], normal) ** 2 + apart)
    total = jnp.zeros_like(height)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        along = _unit(edges[first])
        ahead, behind = _dot(ends[second], along), _dot(ends[first], along)
        outwards = _dot(ends[first], _cross(along, normal))
        from_edge = outwards**2 + height**2
        # Of two equivalent forms, the one without cancellation.
        forwards = ahead + behind > 0
        above = jnp.where(forwards, distance[second] + ahead, distance[first] - behind)
        below = jnp.where(forwards, distance[first] + behind, distance[second] - ahead)
        logarithm = jnp.log(jnp.maximum(above, SMALLEST) / jnp.maximum(below, SMALLEST))
        # The difference of two angles, each within ±π/2.
        far = from_edge + height * distance[second]
        near = from_edge + height * distance[first]
        angle = jnp.arctan2(
            outwards * (ahead * near - behind * far), far * near + outwards**2 * ahead * behind
        )
        total += jnp.where(from_edge > 0, outwards * logarithm, 0.0) - height * angle
    return total


def _dot(one: Vector, other: Vector) -> Array:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _cross(one: Vector, other: Vector) -> Vector:
    (a, b, c), (x, y, z) = one, other
    return [b * z - c * y, c * x - a * z, a * y - b * x]


def _unit(vector: Vector) -> Vector:
    inverse = 1 / jnp.maximum(jnp.sqrt(_dot(vector, vector)), SMALLEST)
    return [component * inverse for component in vector]
