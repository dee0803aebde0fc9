"""Vectors everywhere on a grid, as three arrays, and what a program keeps of them in memory.

XLA fuses operations on three arrays into one loop over the grid; with components along an axis it
would write every intermediate vector to memory. It would also compute again what several loops
need: :func:`materialised` says what to write to memory instead.
"""

from collections.abc import Callable
from functools import reduce, wraps
from typing import ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array, Float

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

Component = Float[Array, "*grid"]
Vector = tuple[Component, Component, Component]  # x, y and z everywhere on a grid
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def materialised(stage: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorator of a function whose results a program for the processor keeps in memory.

    Otherwise XLA fuses it into every loop that uses a result. An optimisation barrier does not
    help, since XLA removes it before it fuses.
    """

    @jax.jit
    def inlining(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        # The metadata of a call are those of all calls in it.
        with set_xla_metadata(inlineable="true"):
            return stage(*arguments, **named)

    @wraps(stage)
    def called(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        if jax.default_backend() != "cpu":
            return stage(*arguments, **named)
        with set_xla_metadata(inlineable="false"):
            return inlining(*arguments, **named)

    return called


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


def arctan2(y: Component, x: Component) -> Component:
    """atan2(y, x) in arithmetic alone, for which XLA would call a function for each element."""
    size_x = jnp.abs(x)
    size_y = jnp.abs(y)
    smaller = jnp.minimum(size_x, size_y)
    larger = jnp.maximum(size_x, size_y)
    steep = smaller > np.tan(np.pi / 8) * larger
    tangent = jnp.where(steep, smaller - larger, smaller) / jnp.where(
        steep, smaller + larger, larger
    )
    square = tangent * tangent
    # By Horner's rule, with numbers and no array, for speed.
    above, below = (
        reduce(lambda value, coefficient: value * square + coefficient, polynomial)
        for polynomial in (NUMERATOR, DENOMINATOR)
    )
    angle = tangent + tangent * square * above / below + jnp.where(steep, np.pi / 4, 0.0)
    angle = jnp.where(size_y > size_x, np.pi / 2 - angle, angle)
    angle = jnp.where(x < 0, np.pi - angle, angle)
    return jnp.where(y < 0, -angle, angle)
