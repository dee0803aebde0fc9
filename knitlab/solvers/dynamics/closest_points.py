"""Closest points of a node and a triangle, and of two edges, in JAX.

The points are given as weights of the corners of both parts.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.solvers.dynamics.vectors import Component, Vector, add, dot, scale, subtract

Kind = Literal["triangle", "edges"]  # of a pair of parts: a node and a triangle, or two edges
Corners = tuple[Vector, Vector, Vector, Vector]
"""A node and the corners of a triangle, or the ends of one edge and those of another."""
Weights = tuple[Component, Component, Component, Component]
"""Weights of the corners whose sum leads from the closest point of the second part to the first."""


class Crossing(NamedTuple):
    """How two edges cross: the square of their cross product, and half its derivatives by both."""

    squared: Component  # [mm⁴]
    by_first: Vector  # [mm³]
    by_second: Vector


def node_and_triangle(corners: Corners) -> Weights:
    """Weights of a node and a triangle (Ericson, Real-Time Collision Detection, Sec. 5.1.5)."""
    point, first, second, third = corners
    one = subtract(second, first)
    other = subtract(third, first)
    to = subtract(point, first)
    square_one = dot(one, one)
    square_other = dot(other, other)
    mixed = dot(one, other)
    # Products of both sides with the vectors from each corner to the node.
    one_1 = dot(one, to)
    other_1 = dot(other, to)
    one_2 = one_1 - square_one
    other_2 = other_1 - mixed
    one_3 = one_1 - mixed
    other_3 = other_1 - square_other
    area_1 = one_2 * other_3 - one_3 * other_2
    area_2 = one_3 * other_1 - one_1 * other_3
    area_3 = one_1 * other_2 - one_2 * other_1
    whole = area_1 + area_2 + area_3
    second_part = area_2 / whole
    third_part = area_3 / whole
    # Beside the side opposite to a corner, then beyond a corner.
    beside = (area_1 <= 0) & (other_2 >= one_2) & (one_3 >= other_3)
    along = (other_2 - one_2) / ((other_2 - one_2) + (one_3 - other_3))
    second_part = jnp.where(beside, 1 - along, second_part)
    third_part = jnp.where(beside, along, third_part)
    beside = (area_2 <= 0) & (other_1 >= 0) & (other_3 <= 0)
    second_part = jnp.where(beside, 0.0, second_part)
    third_part = jnp.where(beside, other_1 / (other_1 - other_3), third_part)
    beside = (area_3 <= 0) & (one_1 >= 0) & (one_2 <= 0)
    second_part = jnp.where(beside, one_1 / (one_1 - one_2), second_part)
    third_part = jnp.where(beside, 0.0, third_part)
    at_1 = (one_1 <= 0) & (other_1 <= 0)
    at_2 = (one_2 >= 0) & (other_2 <= one_2)
    at_3 = (other_3 >= 0) & (one_3 <= other_3)
    second_part = jnp.where(at_2, 1.0, jnp.where(at_1 | at_3, 0.0, second_part))
    third_part = jnp.where(at_3, 1.0, jnp.where(at_1 | at_2, 0.0, third_part))
    return jnp.ones_like(whole), second_part + third_part - 1, -second_part, -third_part


def two_edges(corners: Corners) -> Weights:
    """Weights of the ends of two edges (Ericson, Sec. 5.1.9)."""
    start, end, other_start, other_end = corners
    first = subtract(end, start)
    second = subtract(other_end, other_start)
    between = subtract(start, other_start)
    square = dot(first, first)
    other_square = dot(second, second)
    mixed = dot(first, second)
    at_first = dot(first, between)
    at_second = dot(second, between)
    crossed = square * other_square - mixed**2
    skew = crossed > 1e-14 * square * other_square
    part = (mixed * at_second - at_first * other_square) / jnp.where(skew, crossed, 1.0)
    part = jnp.clip(jnp.where(skew, part, 0.0), 0.0, 1.0)
    other_part = (mixed * part + at_second) / other_square
    clipped = jnp.clip(other_part, 0.0, 1.0)
    part_beside = jnp.clip((mixed * clipped - at_first) / square, 0.0, 1.0)
    part = jnp.where(clipped == other_part, part, part_beside)
    return 1 - part, part, clipped - 1, -clipped


CLOSEST: dict[Kind, Callable[[Corners], Weights]] = {
    "triangle": node_and_triangle,
    "edges": two_edges,
}


def crossing(corners: Corners) -> Crossing:
    """How two edges cross."""
    start, end, other_start, other_end = corners
    first = subtract(end, start)
    second = subtract(other_end, other_start)
    square = dot(first, first)
    other_square = dot(second, second)
    mixed = dot(first, second)
    return Crossing(
        square * other_square - mixed**2,
        subtract(scale(other_square, first), scale(mixed, second)),
        subtract(scale(square, second), scale(mixed, first)),
    )


def separation(weights: Weights, corners: Corners) -> Vector:
    """Vector from the closest point of the second part to that of the first [mm]."""
    return add(*(scale(weight, corner) for weight, corner in zip(weights, corners, strict=True)))


def distance(corners: Float[Array, "4 3 pair"], kind: Kind) -> Float[Array, " pair"]:
    """Distances of pairs of one kind, given the positions of their corners [mm]."""
    one, two, three, four = ((each[0], each[1], each[2]) for each in corners)
    between = separation(CLOSEST[kind]((one, two, three, four)), (one, two, three, four))
    return jnp.sqrt(dot(between, between))
