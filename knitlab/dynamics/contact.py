"""Contact of the fabric with itself: the barrier of :mod:`knitlab.fabric.barrier`, in JAX.

The potential is that of equilibria, so that a motion comes to rest where they are. It is a sum over
pairs of parts, a node and a triangle or two edges (Li et al., Incremental Potential Contact, ACM
Trans. Graph. 39, 2020), which :mod:`knitlab.dynamics.contact_pairs` lists. Lists have spare places
and are read in chunks, so that one program serves lists of any length.
"""

from functools import partial, wraps
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from knitlab.dynamics.vectors import Component, Vector, add, cross, dot, kept, scale, subtract

CHUNK = 256  # pairs that are evaluated together

Kind = Literal["triangle", "edges"]  # of a pair: a node and a triangle, or two edges

Corners = tuple[Vector, Vector, Vector, Vector]
Weights = tuple[Component, Component, Component, Component]
"""Of the corners: the sum of the weighted corners leads from one closest point to the other."""


class PairList(NamedTuple):
    """Pairs of one kind that may come within reach, by their four corners.

    A node and a triangle, or the ends of one edge and those of the other. Places that are not used
    have a ``range_squared`` of −1.
    """

    nodes: Int[Array, "*batch 4 pair"]  # of the corners, numbered along the rows of the grid
    turns: Int[Array, "*batch 2 4 pair"]  # sides L_x, L_y between a node and its image
    least_squared: Float[Array, "*batch pair"]  # square of the distance that parts keep [mm²]
    # square of the distance at which the barrier begins, less that of the least [mm²]
    range_squared: Float[Array, "*batch pair"]
    strength: Float[Array, "*batch pair"]  # of the barrier [N/mm³]
    # squared sine times squared lengths below which edges count as parallel; 0 for a triangle [mm⁴]
    parallel: Float[Array, "*batch pair"]


class Contact(eqx.Module):
    """All pairs that can come within reach before they are listed again."""

    triangles: PairList  # a node and a triangle
    edges: PairList  # two edges
    chunks: Int[Array, "2"]  # that hold pairs in any fabric of a batch: triangles, and edges
    periodic: bool = eqx.field(static=True)

    def energy(self, positions: Vector, lengths: Float[Array, "2"]) -> Float[Array, ""]:
        """Energy of the barrier [N mm]; NaN where parts are nearer than they may be."""
        place = tuple(each.ravel() for each in positions)
        total = jnp.zeros(())
        for pairs, chunks, closest in self._kinds():

            def added(number: Any, energy: Array, pairs: Any = pairs, closest: Any = closest) -> Array:
                chunk = _chunk(pairs, number)
                corners = self._corners(chunk, place, lengths)
                weights, crossed = closest(corners)
                value, _ = _barrier(chunk, _squared(weights, corners))
                return energy + jnp.sum(value * _mollified(chunk, crossed)[0])

            total = jax.lax.fori_loop(0, chunks, added, total)
        return total

    def gradient(
        self, positions: Vector, lengths: Float[Array, "2"]
    ) -> tuple[Vector, Float[Array, "2"]]:
        """Derivatives of the energy by the positions of nodes and by L_x and L_y [N]."""
        place = tuple(each.ravel() for each in positions)
        found = (*(jnp.zeros_like(each) for each in place), jnp.zeros(2))
        for pairs, chunks, closest in self._kinds():

            def added(number: Any, sums: Any, pairs: Any = pairs, closest: Any = closest) -> Any:
                chunk = _chunk(pairs, number)
                forces = _forces(chunk, self._corners(chunk, place, lengths), closest)
                *nodes, sides = sums
                for axis in range(3):
                    by_corner = jnp.stack([force[axis] for force in forces])
                    nodes[axis] = (
                        nodes[axis].at[chunk.nodes].add(by_corner, mode="promise_in_bounds")
                    )
                    if self.periodic and axis < 2:
                        sides = sides.at[axis].add(jnp.sum(chunk.turns[axis] * by_corner))
                return (*nodes, sides)

            found = jax.lax.fori_loop(0, chunks, added, found)
        x, y, z, sides = found
        grid = positions[0].shape
        return (x.reshape(grid), y.reshape(grid), z.reshape(grid)), sides

    def kick(
        self,
        positions: Vector,
        lengths: Float[Array, "2"],
        velocity: Vector,
        rates: Float[Array, "2"],
        push: tuple[Vector, Float[Array, "2"]],
        drift: Float[Array, ""],
    ) -> tuple[Vector, Float[Array, "2"]]:
        """Change of velocity by the barrier as it acts after a drift [ms], partly implicit.

        ``velocity`` and ``rates`` are those without it [mm/ms], and ``push`` the change of velocity
        by a unit force. Each pair finds its own force at the distance to which the drift leads,
        with the masses of its corners shared among the pairs that act on them, so that many stiff
        pairs are stable together. At rest the force is that of the distance.
        """
        grid = positions[0].shape
        place = [each.ravel() for each in positions]
        pushed, side_push = push
        pushed = [jnp.broadcast_to(each, grid).ravel() for each in pushed]
        free = [each.ravel() for each in velocity]
        softness = jnp.maximum(jnp.maximum(pushed[0], pushed[1]), pushed[2])

        # Forces at the present distances, and how many pairs share each mass.
        sums = ([jnp.zeros_like(each) for each in place], jnp.zeros(2))
        shares = jnp.zeros_like(place[0]), jnp.zeros(2)
        for pairs, chunks, closest in self._kinds():

            def guessed(number: Any, found: Any, pairs: Any = pairs, closest: Any = closest) -> Any:
                (nodes, sides), (share, side_share) = found
                chunk = _chunk(pairs, number)
                pair = _approach(chunk, self._corners(chunk, place, lengths), closest)
                speed = self._speed(chunk, pair, free, rates)
                force = _guess(chunk, pair.distance) * pair.factor
                ahead = pair.distance + drift * speed
                acting = (pair.distance < pair.begins) | (ahead < pair.begins)
                nodes, sides = self._spread(chunk, pair, force, nodes, sides)
                weights = jnp.abs(jnp.stack(pair.weights)) * acting
                share = share.at[chunk.nodes].add(weights, mode="promise_in_bounds")
                if self.periodic:
                    side_share = side_share + jnp.abs(pair.turns(chunk)) @ acting
                return (nodes, sides), (share, side_share)

            sums, shares = jax.lax.fori_loop(0, chunks, guessed, (sums, shares))
        (nodes, sides), (share, side_share) = sums, shares
        ahead = [v + p * f for v, p, f in zip(free, pushed, nodes, strict=True)]
        ahead_sides = rates + side_push * sides
        softness, side_softness = softness * share, side_push * side_share

        for pairs, chunks, closest in self._kinds():

            def solved(number: Any, sums: Any, pairs: Any = pairs, closest: Any = closest) -> Any:
                nodes, sides = sums
                chunk = _chunk(pairs, number)
                pair = _approach(chunk, self._corners(chunk, place, lengths), closest)
                speed = self._speed(chunk, pair, ahead, ahead_sides)
                soft = sum(
                    jnp.abs(weight) * softness.at[chunk.nodes[corner]].get(mode="promise_in_bounds")
                    for corner, weight in enumerate(pair.weights)
                )
                if self.periodic:
                    soft = soft + side_softness @ jnp.abs(pair.turns(chunk))
                guess = _guess(chunk, pair.distance)
                soft = drift * soft * pair.factor
                reached = pair.distance + drift * speed - soft * guess
                force = (_implicit(chunk, pair.begins, reached, soft, pair.distance) - guess) * pair.factor
                return self._spread(chunk, pair, force, nodes, sides)

            nodes, sides = jax.lax.fori_loop(0, chunks, solved, (nodes, sides))
        x, y, z = (f.reshape(grid) for f in nodes)
        return (push[0][0] * x, push[0][1] * y, push[0][2] * z), side_push * sides

    def _speed(self, pairs: PairList, pair: "Approach", velocity: Any, rates: Any) -> Component:
        """Rate of the distance [mm/ms]."""
        corners = self._corners(pairs, velocity, rates)
        return dot(_separation(pair.weights, corners), pair.normal)

    def _spread(
        self, pairs: PairList, pair: "Approach", force: Component, nodes: Any, sides: Any
    ) -> Any:
        """Add repulsive forces of pairs to those on nodes, and on L_x and L_y."""
        nodes = [
            total.at[pairs.nodes].add(
                jnp.stack([weight * force * along for weight in pair.weights]),
                mode="promise_in_bounds",
            )
            for total, along in zip(nodes, pair.normal, strict=True)
        ]
        if self.periodic:
            sides = sides + jnp.stack(
                [jnp.sum(force * along * turn) for along, turn in zip(pair.normal[:2], pair.turns(pairs))]
            )
        return nodes, sides

    def _kinds(self) -> tuple[tuple[PairList, Array, Any], ...]:
        return (
            (self.triangles, self.chunks[0], CLOSEST["triangle"]),
            (self.edges, self.chunks[1], CLOSEST["edges"]),
        )

    def _corners(self, pairs: PairList, place: Any, lengths: Float[Array, "2"]) -> Corners:
        """Positions of the corners of pairs [mm]."""
        corners = []
        for corner in range(4):
            nodes = pairs.nodes[corner]
            at = [each.at[nodes].get(mode="promise_in_bounds") for each in place]
            if self.periodic:
                for axis in range(2):
                    at[axis] = at[axis] + lengths[axis] * pairs.turns[axis, corner]
            corners.append(tuple(at))
        return tuple(corners)


def node_and_triangle(corners: Corners) -> tuple[Weights, None]:
    """Weights of a point and of the corners of a triangle, for their closest points."""
    point, first, second, third = corners
    one, other, to = subtract(second, first), subtract(third, first), subtract(point, first)
    square_one, square_other, mixed = dot(one, one), dot(other, other), dot(one, other)
    # The point by its products with the sides, seen from each corner in turn (Ericson, Real-Time
    # Collision Detection, 2005, Sec. 5.1.5).
    one_1, other_1 = dot(one, to), dot(other, to)
    one_2, other_2 = one_1 - square_one, other_1 - mixed
    one_3, other_3 = one_1 - mixed, other_1 - square_other
    area_1 = one_2 * other_3 - one_3 * other_2
    area_2 = one_3 * other_1 - one_1 * other_3
    area_3 = one_1 * other_2 - one_2 * other_1
    whole = area_1 + area_2 + area_3
    second_part, third_part = area_2 / whole, area_3 / whole
    beside_1 = (area_1 <= 0) & (other_2 >= one_2) & (one_3 >= other_3)
    along = (other_2 - one_2) / ((other_2 - one_2) + (one_3 - other_3))
    second_part = jnp.where(beside_1, 1 - along, second_part)
    third_part = jnp.where(beside_1, along, third_part)
    beside_2 = (area_2 <= 0) & (other_1 >= 0) & (other_3 <= 0)
    second_part = jnp.where(beside_2, 0.0, second_part)
    third_part = jnp.where(beside_2, other_1 / (other_1 - other_3), third_part)
    beside_3 = (area_3 <= 0) & (one_1 >= 0) & (one_2 <= 0)
    second_part = jnp.where(beside_3, one_1 / (one_1 - one_2), second_part)
    third_part = jnp.where(beside_3, 0.0, third_part)
    at_1 = (one_1 <= 0) & (other_1 <= 0)
    at_2 = (one_2 >= 0) & (other_2 <= one_2)
    at_3 = (other_3 >= 0) & (one_3 <= other_3)
    second_part = jnp.where(at_2, 1.0, jnp.where(at_1 | at_3, 0.0, second_part))
    third_part = jnp.where(at_3, 1.0, jnp.where(at_1 | at_2, 0.0, third_part))
    none = jnp.ones_like(second_part)
    return (none, second_part + third_part - 1, -second_part, -third_part), None


def two_edges(corners: Corners) -> tuple[Weights, "Crossed"]:
    """Weights of the ends of two edges, for their closest points, and how the edges cross."""
    start, end, other_start, other_end = corners
    along, other, between = (
        subtract(end, start),
        subtract(other_end, other_start),
        subtract(start, other_start),
    )
    square, other_square, mixed = dot(along, along), dot(other, other), dot(along, other)
    at_start, at_other = dot(along, between), dot(other, between)
    crossed = square * other_square - mixed**2
    # Ericson, Sec. 5.1.9: clamp the point of the first line, then that of the second, and once more.
    skew = crossed > 1e-14 * square * other_square
    part = (mixed * at_other - at_start * other_square) / jnp.where(skew, crossed, 1.0)
    part = jnp.clip(jnp.where(skew, part, 0.0), 0.0, 1.0)
    other_part = (mixed * part + at_other) / other_square
    clamped = jnp.clip(other_part, 0.0, 1.0)
    again = jnp.clip((mixed * clamped - at_start) / square, 0.0, 1.0)
    part = jnp.where(clamped == other_part, part, again)
    return (1 - part, part, clamped - 1, -clamped), Crossed(
        crossed, along, other, square, other_square, mixed
    )


class Approach(NamedTuple):
    """How the parts of pairs lie to each other."""

    weights: Weights
    normal: Vector  # the direction in which they are apart
    distance: Component  # [mm]
    begins: Component  # distance at which the barrier begins [mm]
    factor: Component  # of nearly parallel edges

    def turns(self, pairs: PairList) -> Float[Array, "2 pair"]:
        """Sides L_x and L_y by which the closest points are images of each other."""
        return jnp.einsum("kp,akp->ap", jnp.stack(self.weights), pairs.turns)


NEWTON = 4
DEEPEST = 0.05  # excess over its range, below which a guess of the force does not grow


def _approach(pairs: PairList, corners: Corners, closest: Any) -> Approach:
    return _KEPT[closest](pairs, corners)


def _approaching(pairs: PairList, corners: Corners, closest: Any) -> Approach:
    weights, crossed = closest(corners)
    separation = _separation(weights, corners)
    distance = jnp.sqrt(dot(separation, separation))
    factor = jnp.ones_like(distance) * _mollified(pairs, crossed)[0]
    begins = jnp.sqrt(jnp.maximum(pairs.range_squared + pairs.least_squared, 0.0))
    return Approach(weights, scale(1 / jnp.maximum(distance, 1e-300), separation), distance, begins, factor)


_KEPT = {f: kept(partial(_approaching, closest=f)) for f in (node_and_triangle, two_edges)}


def _rise(part: Component) -> tuple[Component, Component]:
    """The barrier's slope by its excess over its range, negative, and the derivative of that."""
    left, logarithm = 1 - part, jnp.log(part)
    return left * (left / part - 2 * logarithm), 2 * logarithm - (left / part) * (4 + left / part)


@kept
def _guess(pairs: PairList, distance: Component) -> Component:
    """Force at a distance, not more than at a small one [N]."""
    part = (distance**2 - pairs.least_squared) / pairs.range_squared
    part = jnp.where(pairs.range_squared > 0, jnp.clip(part, DEEPEST, 1.0), 1.0)
    return 2 * distance * pairs.strength * pairs.range_squared * _rise(part)[0]


@kept
def _implicit(
    pairs: PairList, begins: Component, reached: Component, softness: Component, distance: Component
) -> Component:
    """Force f of pairs that keeps them at the distance reached + softness · f, f that of it [N].

    ``reached`` is the distance without force [mm], and ``softness`` the distance gained by a unit
    force [mm/N]. By Newton's method for the excess of the squared distance over its range, from
    below, where it converges monotonically.
    """
    used = pairs.range_squared > 0
    largest = jnp.where(used, pairs.range_squared, 1.0)
    least = jnp.where(used, pairs.least_squared, 1.0)
    begins = jnp.where(used, begins, 1.0)
    scale_ = 2 * pairs.strength * largest
    touching = used & (reached < begins)
    room = jnp.where(touching, begins - reached, 0.0)
    ratio = room / jnp.maximum(softness * scale_ * jnp.sqrt(least), 1e-30)
    part = 2 / ((2 + ratio) + jnp.sqrt(ratio * (ratio + 4)))
    for _ in range(NEWTON):
        at = jnp.sqrt(least + largest * part)
        rise, slope = _rise(part)
        value = at - reached - softness * scale_ * at * rise
        by_part = largest / (2 * at) * (1 - softness * scale_ * rise) - softness * scale_ * at * slope
        part = jnp.clip(part - value / by_part, 1e-12, 1.0)
    at = jnp.sqrt(least + largest * part)
    return jnp.where(touching, scale_ * at * _rise(part)[0], 0.0)


class Crossed(NamedTuple):
    """The square of the cross product of two edges [mm⁴], and their scalar products [mm²]."""

    squared: Component
    along: Vector
    other: Vector
    square: Component
    other_square: Component
    mixed: Component


CLOSEST: dict[Kind, Any] = {"triangle": node_and_triangle, "edges": two_edges}


def squared_distance(corners: Float[Array, "4 3 pair"], kind: Kind) -> Float[Array, " pair"]:
    """Squared distances of pairs of one kind [mm²]."""
    vectors: Any = tuple(tuple(corner) for corner in corners)
    weights, _ = CLOSEST[kind](vectors)
    return _squared(weights, vectors)


def _chunk(pairs: PairList, number: Int[Array, ""]) -> PairList:
    return jax.tree.map(
        lambda each: jax.lax.dynamic_slice_in_dim(each, number * CHUNK, CHUNK, axis=-1), pairs
    )


def _separation(weights: Weights, corners: Corners) -> Vector:
    return add(*(scale(weight, at) for weight, at in zip(weights, corners, strict=True)))


def _squared(weights: Weights, corners: Corners) -> Component:
    separation = _separation(weights, corners)
    return dot(separation, separation)


def _barrier(pairs: PairList, squared: Component) -> tuple[Component, Component]:
    """Energy of pairs by their squared distance, without mollifier, and its derivative."""
    excess, largest = squared - pairs.least_squared, pairs.range_squared
    active = excess < largest
    excess = jnp.where(active, excess, largest)
    below, logarithm = excess - largest, jnp.log(excess / largest)
    value = -pairs.strength * below**2 * logarithm
    slope = -pairs.strength * below * (2 * logarithm + below / excess)
    return jnp.where(active, value, 0.0), jnp.where(active, slope, 0.0)


def _mollified(pairs: PairList, crossed: Crossed | None) -> tuple[Component | float, Component | float]:
    """Factor that lets pairs of nearly parallel edges vanish, and its derivative by ``squared``."""
    if crossed is None:
        return 1.0, 0.0
    part = jnp.minimum(crossed.squared / pairs.parallel, 1.0)
    return (2 - part) * part, 2 * (1 - part) / pairs.parallel


def _forces(pairs: PairList, corners: Corners, closest: Any) -> Corners:
    """Derivatives of the energy of pairs by their corners [N]."""
    weights, crossed = closest(corners)
    separation = _separation(weights, corners)
    value, slope = _barrier(pairs, dot(separation, separation))
    factor, turning = _mollified(pairs, crossed)
    pull = scale(2 * slope * factor, separation)
    forces = tuple(scale(weight, pull) for weight in weights)
    if crossed is None:
        return forces
    # The derivative of |a × b|² by a is 2 (b·b a − a·b b).
    spread = 2 * value * turning
    by_along = scale(
        spread,
        subtract(scale(crossed.other_square, crossed.along), scale(crossed.mixed, crossed.other)),
    )
    by_other = scale(
        spread, subtract(scale(crossed.square, crossed.other), scale(crossed.mixed, crossed.along))
    )
    start, end, other_start, other_end = forces
    return (
        subtract(start, by_along),
        add(end, by_along),
        subtract(other_start, by_other),
        add(other_end, by_other),
    )
