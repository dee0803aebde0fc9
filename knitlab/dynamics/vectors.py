"""Vectors as three separate arrays, and an arc tangent that a compiler can vectorise.

XLA fuses operations on separate components into one loop over the grid. With the components along
an axis of one array it would write every intermediate vector to memory.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Component = Float[Array, "*grid"]
Vector = tuple[Component, Component, Component]
"""The x, y and z components of a vector at every place of a grid."""


def add(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    return jax.tree.map(lambda *parts: sum(parts[1:], parts[0]), *vectors)


def subtract(one: Vector, other: Vector) -> Vector:
    """Difference of two vectors."""
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def scale(factor: Component, vector: Vector) -> Vector:
    """A vector times a number."""
    return factor * vector[0], factor * vector[1], factor * vector[2]


def dot(one: Vector, other: Vector) -> Component:
    """Scalar product."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def norm(vector: Vector) -> Component:
    """Length of a vector."""
    return jnp.sqrt(dot(vector, vector))


def cross(one: Vector, other: Vector) -> Vector:
    """Vector product."""
    return (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )


NUMERATOR = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
DENOMINATOR = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
"""Rational approximation of (atan t − t)/t³ in t², for t up to tan(π/8), from Cephes."""


def arctan2(y: Component, x: Component) -> Component:
    """atan2(y, x) to a few units in the last place, in arithmetic alone.

    XLA computes ``jnp.arctan2`` on a CPU by a call for each element, which takes longer than all
    else in a time step.
    """
    size_x, size_y = jnp.abs(x), jnp.abs(y)
    smaller, larger = jnp.minimum(size_x, size_y), jnp.maximum(size_x, size_y)
    steep = smaller > np.tan(np.pi / 8) * larger
    tangent = jnp.where(steep, smaller - larger, smaller) / jnp.where(
        steep, smaller + larger, larger
    )
    square = tangent * tangent
    above, below = (_polynomial(each, square) for each in (NUMERATOR, DENOMINATOR))
    angle = tangent + tangent * square * above / below + jnp.where(steep, np.pi / 4, 0.0)
    angle = jnp.where(size_y > size_x, np.pi / 2 - angle, angle)
    angle = jnp.where(x < 0, np.pi - angle, angle)
    return jnp.where(y < 0, -angle, angle)


def _polynomial(coefficients: tuple[float, ...], of: Component) -> Component:
    """A polynomial by Horner's rule, highest power first; numbers and no array, for speed."""
    value = coefficients[0] * of + coefficients[1]
    for coefficient in coefficients[2:]:
        value = value * of + coefficient
    return value
