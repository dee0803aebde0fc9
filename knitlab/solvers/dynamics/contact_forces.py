"""Forces of contact in motion: the barrier of equilibria, in JAX, over one step in time.

The potential is that of :mod:`knitlab.solvers.equilibrium.contact_barrier`, so that a motion comes
to rest where equilibria are. Pairs of parts come from ``contact_pairs.py``, in lists with spare
places that are read in chunks: one program serves many lengths.

The barrier is too stiff for explicit steps: every pair finds its force at the distance to which the
step leads, with its share of the mass of a node (mass splitting: Tonge, Benevolenski and
Voroshilov, ACM Trans. Graph. 31, 2012). Forces at the present distances come first, in collisions
only as far as they are stable; in each sweep every pair then finds its force given those of the
others, until none changes. With one sweep, pressed folds would close.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from knitlab.solvers.dynamics.grid import Shape
from knitlab.solvers.dynamics.vectors import (
    Component,
    Vector,
    add,
    dot,
    materialised,
    scale,
    subtract,
)

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


# Excess over its range below which energies and their derivatives do not grow: in motion, parts may
# for a moment be nearer than the least.
TOUCHING = 1e-9

OfNodes = list[Float[Array, " node"]]  # components along x, y and z
OfCorners = list[Float[Array, "4 pair"]]  # the same of the corners of pairs
Totals = tuple[OfNodes, Float[Array, "2"]]  # of nodes, and of L_x and L_y
Result = TypeVar("Result")


def chunk_size() -> int:
    """Number of pairs that are evaluated together: few on a processor, where few act."""
    return 128 if jax.default_backend() == "cpu" else 1 << 14


class PairList(NamedTuple):
    """Pairs of one kind that may come within reach; spare places have a ``range_squared`` of −1."""

    nodes: Int[Array, "*batch 4 pair"]  # numbers of the corners on the grid
    turns: Int[Array, "*batch 2 4 pair"]  # sides L_x, L_y between a node and its image
    least_squared: Float[Array, "*batch pair"]  # square of the distance that parts keep [mm²]
    range_squared: Float[Array, "*batch pair"]  # that at which the barrier begins, less this [mm²]
    strength: Float[Array, "*batch pair"]  # of the barrier [N/mm³]
    parallel: Float[Array, "*batch pair"]  # squared cross product of nearly parallel edges [mm⁴]

    @property
    def begins(self) -> Component:
        """Distance at which the barrier begins [mm]."""
        return jnp.sqrt(jnp.abs(self.least_squared + self.range_squared))

    def stored(self, excess: Component) -> Component:
        """Energy by the excess of the squared distance over its range [N mm]."""
        return -self.strength * (self.range_squared * (1 - excess)) ** 2 * jnp.log(excess)

    def force(self, distance: Component, excess: Component) -> Component:
        """Force that pushes the parts apart [N]."""
        return 2 * self.strength * self.range_squared * steepness(excess)[0] * distance


class Approach(NamedTuple):
    """How the parts of pairs lie to each other."""

    weights: Weights
    normal: Vector  # the direction in which they are apart
    distance: Component  # [mm]
    excess: Component  # of the squared distance over that of the least, by its range
    factor: Component  # by which nearly parallel edges count


class Chunk(NamedTuple):
    """Some pairs of a list, and how they lie."""

    kind: Kind
    number: Int[Array, ""]
    pairs: PairList
    approach: Approach

    def of(self, whole: Array) -> Array:
        """Its part of an array that has an entry for every pair of the list."""
        return chunk_slice(whole, self.number)

    def put(self, whole: Array, part: Array) -> Array:
        """The array with another such part."""
        return jax.lax.dynamic_update_slice_in_dim(whole, part, self.number * chunk_size(), 0)


class Contact(eqx.Module):
    """All pairs that can come within reach before they are listed again."""

    lists: dict[Kind, PairList]
    chunks: dict[Kind, Int[Array, ""]]  # that hold pairs, in any fabric of a batch
    periodic: bool = eqx.field(static=True)

    def energy(self, positions: Vector, lengths: Float[Array, "2"]) -> Float[Array, ""]:
        """Energy of the barrier [N mm], finite where parts are nearer than they may be."""

        def added(chunk: Chunk, total: Array) -> Array:
            return total + jnp.sum(
                chunk.approach.factor * chunk.pairs.stored(chunk.approach.excess)
            )

        return self.over_chunks((flat(positions), lengths), added, jnp.zeros(()))

    def gradient(
        self, positions: Vector, lengths: Float[Array, "2"]
    ) -> tuple[Vector, Float[Array, "2"]]:
        """Derivatives of the energy by the positions of nodes and by L_x and L_y [N]."""
        place = flat(positions), lengths

        def added(chunk: Chunk, totals: Totals) -> Totals:
            _, _, pairs, (_, _, distance, excess, factor) = chunk
            totals = self.add(chunk, -pairs.force(distance, excess) * factor, totals)
            return self.add_twist(chunk, pairs.stored(excess), place, totals)

        (x, y, z), sides = self.over_chunks(place, added, nothing(place))
        grid = positions[0].shape
        return (x.reshape(grid), y.reshape(grid), z.reshape(grid)), sides

    def over_chunks(
        self, place: Totals, visit: Callable[[Chunk, Result], Result], begin: Result
    ) -> Result:
        """Last result of a function that is called with each chunk and its previous result."""
        for kind in self.lists:

            def visited(number: Array, found: Result, kind: Kind = kind) -> Result:
                pairs = self.pairs(kind, number)
                approach = APPROACHES[kind](pairs, self.corners(pairs, place))
                return visit(Chunk(kind, number, pairs, approach), found)

            begin = jax.lax.fori_loop(0, self.chunks[kind], visited, begin)
        return begin

    def pairs(self, kind: Kind, number: Int[Array, ""]) -> PairList:
        """The pairs of a chunk."""
        return jax.tree.map(lambda each: chunk_slice(each, number), self.lists[kind])

    def corners(self, pairs: PairList, of: Totals) -> Corners:
        """Vectors at the corners of pairs, from those of the nodes and of a period."""
        of_nodes, sides = of
        corners = []
        for corner in range(4):
            nodes = pairs.nodes[corner]
            x, y, z = (each.at[nodes].get(mode="promise_in_bounds") for each in of_nodes)
            if self.periodic:
                x = x + sides[0] * pairs.turns[0, corner]
                y = y + sides[1] * pairs.turns[1, corner]
            corners.append((x, y, z))
        one, two, three, four = corners
        return one, two, three, four

    def add(self, chunk: Chunk, force: Component, totals: Totals) -> Totals:
        """Add forces that push the parts of pairs apart."""
        push = scale(force, chunk.approach.normal)
        by_corner = [
            jnp.stack([weight * each for weight in chunk.approach.weights]) for each in push
        ]
        return self._scattered(chunk.pairs, by_corner, totals)

    def add_twist(self, chunk: Chunk, force: Component, place: Totals, totals: Totals) -> Totals:
        """Add forces along the derivatives of the factor of nearly parallel edges."""
        if chunk.kind != "edges":
            return totals
        by_corner = _twists(chunk.pairs, self.corners(chunk.pairs, place), force)
        return self._scattered(chunk.pairs, by_corner, totals)

    def _scattered(self, pairs: PairList, by_corner: OfCorners, totals: Totals) -> Totals:
        nodes, sides = totals
        nodes = [
            total.at[pairs.nodes].add(each, mode="promise_in_bounds")
            for total, each in zip(nodes, by_corner, strict=True)
        ]
        if self.periodic:
            sides = sides + jnp.stack(
                [jnp.sum(pairs.turns[axis] * by_corner[axis]) for axis in range(2)]
            )
        return nodes, sides


def flat(vector: Vector) -> OfNodes:
    """Components of all nodes, in rows of the grid."""
    return [each.ravel() for each in vector]


def nothing(place: Totals) -> Totals:
    """Totals of no pairs."""
    return jax.tree.map(jnp.zeros_like, place)


def chunk_slice(whole: Array, number: Int[Array, ""]) -> Array:
    """The part of a chunk of an array whose last axis has an entry for every pair of a list."""
    return jax.lax.dynamic_slice_in_dim(whole, number * chunk_size(), chunk_size(), axis=-1)


def steepness(excess: Component) -> tuple[Component, Component]:
    """Decrease of the energy with the excess, over its scale, and the derivative of that."""
    left = 1 - excess
    logarithm = jnp.log(excess)
    return (
        left * (left / excess - 2 * logarithm),
        2 * logarithm - left / excess * (4 + left / excess),
    )


def _approach(pairs: PairList, corners: Corners, kind: Kind) -> Approach:
    weights = CLOSEST[kind](corners)
    between = separation(weights, corners)
    squared = dot(between, between)
    distance = jnp.sqrt(squared)
    normal = scale(1 / jnp.maximum(distance, 1e-300), between)
    excess = (squared - pairs.least_squared) / pairs.range_squared
    excess = jnp.where(pairs.range_squared > 0, jnp.clip(excess, TOUCHING, 1.0), 1.0)
    factor = jnp.ones_like(excess)
    if kind == "edges":
        part = jnp.minimum(crossing(corners).squared / pairs.parallel, 1.0)
        factor = (2 - part) * part
    return Approach(weights, normal, distance, excess, factor)


@materialised
def _twists(pairs: PairList, corners: Corners, force: Component) -> OfCorners:
    """Forces on the ends of edges along the derivatives of the factor if they are parallel."""
    crossed = crossing(corners)
    part = jnp.minimum(crossed.squared / pairs.parallel, 1.0)
    slope = 4 * (1 - part) / pairs.parallel * force
    ends = zip(scale(slope, crossed.by_first), scale(slope, crossed.by_second), strict=True)
    return [jnp.stack([-first, first, -second, second]) for first, second in ends]


APPROACHES = {kind: materialised(partial(_approach, kind=kind)) for kind in CLOSEST}


NEWTON_STEPS = 4  # for the force of a pair
# At most so many sweeps in which pairs take account of each other's forces, until these move them
# by this part of the distance at which their barriers begin.
SWEEPS = 24
SETTLED = 1e-3
MIN_EXCESS = 0.05  # excess over its range down to which the first force of a step grows
CALM = 0.25  # part of the range left to a pair that it may move by in a step, and count as at rest

OfPairs = dict[Kind, Float[Array, " pair"]]
OfChunks = dict[Kind, Bool[Array, " chunk"]]


class Near(NamedTuple):
    """The pairs of a list in chunks that hold pairs which may touch in the step."""

    chunks: Bool[Array, " chunk"]  # which these are
    touch: Bool[Array, " pair"]  # whether a pair may
    approach: Approach


class Workspace(NamedTuple):
    """Memory for what a step finds of the pairs."""

    near: dict[Kind, Near]
    softness: OfPairs  # distance that a pair gains by a unit force [mm/N]
    forces: OfPairs  # [N]

    @classmethod
    def of(cls, contact: Contact) -> "Workspace":
        """With a place for each pair of the lists."""
        near = dict[Kind, Near]()
        none = dict[Kind, Array]()
        for kind, pairs in contact.lists.items():
            places = none[kind] = jnp.zeros_like(pairs.strength)
            chunks = jnp.zeros(len(places) // chunk_size(), bool)
            approach = Approach((places,) * 4, (places,) * 3, places, places, places)
            near[kind] = Near(chunks, places > 0, approach)
        return cls(near, none, none)


class Sweep(NamedTuple):
    """Forces of pairs, their sums, and the chunks in which they still change."""

    forces: OfPairs  # [N]
    totals: Totals
    changing: OfChunks


@dataclass(frozen=True)
class ContactStep:
    """A fabric about to move for a time step."""

    contact: Contact
    place: Totals  # [mm]
    velocity: Totals  # mean rates over the step by all other forces [mm/ms]
    push: Totals  # change of these by a unit force [mm/ms/N]
    time: Float[Array, ""]  # [ms]

    def near(self, known: dict[Kind, Near]) -> dict[Kind, Near]:
        """The pairs that may touch within the step, in the place of those of the last."""

        def seen(chunk: Chunk, found: dict[Kind, Near]) -> dict[Kind, Near]:
            pairs = chunk.pairs
            approach = chunk.approach
            known = found[chunk.kind]
            ahead = approach.distance + self.time * self._speed(chunk, self.velocity)
            reach = (approach.excess < 1) | (ahead < pairs.begins)
            touch = (pairs.range_squared > 0) & reach
            known = Near(
                known.chunks.at[chunk.number].set(touch.any()),
                chunk.put(known.touch, touch),
                jax.tree.map(chunk.put, known.approach, approach),
            )
            return {**found, chunk.kind: known}

        none = {
            kind: each._replace(chunks=jnp.zeros_like(each.chunks)) for kind, each in known.items()
        }
        return self.contact.over_chunks(self.place, seen, none)

    def forces(self, workspace: Workspace) -> tuple[Totals, Workspace]:
        """Forces of the barrier on nodes, L_x and L_y [N]."""
        near = self.near(workspace.near)
        chunks = {kind: each.chunks for kind, each in near.items()}

        def present(chunk: Chunk) -> Component:
            used = chunk.pairs.range_squared > 0
            (_, _, distance, excess, _) = chunk.approach
            return jnp.where(
                used, chunk.pairs.force(distance, jnp.maximum(excess, MIN_EXCESS)), 0.0
            )

        def counted(chunk: Chunk, found: tuple[Totals, Totals]) -> tuple[Totals, Totals]:
            totals, shares = found
            totals = self.contact.add(chunk, present(chunk) * chunk.approach.factor, totals)
            return totals, self._share(chunk, chunk.of(near[chunk.kind].touch), shares)

        begin = nothing(self.place), ([jnp.zeros_like(self.place[0][0])], jnp.zeros(2))
        present_totals, shares = self._over(near, chunks, counted, begin)
        balanced = self._led(present_totals)
        of_nodes, of_sides = shares
        pushed = self.time * jnp.stack(self.push[0]).max(axis=0) * of_nodes[0]
        softer = self.time * self.push[1] * of_sides

        def first(chunk: Chunk, found: tuple[OfPairs, OfPairs, Totals]) -> Any:
            """The present force, as far as it is stable if the pair is not at rest with it."""
            forces, softness, totals = found
            pairs = chunk.pairs
            approach = chunk.approach
            kind = chunk.kind
            soft = self._softness(chunk, pushed, softer)
            left = jnp.maximum(pairs.begins - approach.distance, 0.0)
            calm = jnp.abs(self.time * self._speed(chunk, balanced)) < CALM * left
            stable = left / jnp.maximum(soft, 1e-30)
            force = present(chunk)
            force = jnp.where(calm, force, jnp.minimum(force, stable))
            stored = pairs.stored(jnp.maximum(approach.excess, MIN_EXCESS))
            totals = self.contact.add_twist(chunk, -stored, self.place, totals)
            totals = self.contact.add(chunk, force * approach.factor, totals)
            forces = {**forces, kind: chunk.put(forces[kind], force)}
            return forces, {**softness, kind: chunk.put(softness[kind], soft)}, totals

        begun = workspace.forces, workspace.softness, nothing(self.place)
        forces, softness, totals = self._over(near, chunks, first, begun)
        settled = self._settled(near, softness, Sweep(forces, totals, chunks))
        return settled.totals, Workspace(near, softness, settled.forces)

    def _settled(self, near: dict[Kind, Near], softness: OfPairs, sweep: Sweep) -> Sweep:
        def unsettled(found: tuple[Int[Array, ""], Sweep]) -> Bool[Array, ""]:
            number, sweep = found
            changing = jnp.array([each.any() for each in sweep.changing.values()])
            return (number < SWEEPS) & changing.any()

        def swept(found: tuple[Int[Array, ""], Sweep]) -> tuple[Int[Array, ""], Sweep]:
            number, last = found
            ahead = self._led(last.totals)

            def corrected(chunk: Chunk, sweep: Sweep) -> Sweep:
                (forces, totals, changing) = sweep
                kind = chunk.kind
                before = chunk.of(forces[kind])
                soft = chunk.of(softness[kind])
                moved = self.time * self._speed(chunk, ahead) - soft * before
                reached = chunk.approach.distance + moved
                force, change = _changed(chunk.pairs, reached, soft, before)
                moves = (soft * jnp.abs(change) > SETTLED * chunk.pairs.begins).any()
                return Sweep(
                    {**forces, kind: chunk.put(forces[kind], force)},
                    self.contact.add(chunk, change * chunk.approach.factor, totals),
                    {**changing, kind: changing[kind].at[chunk.number].set(moves)},
                )

            return number + 1, self._over(near, last.changing, corrected, last)

        _, settled = jax.lax.while_loop(unsettled, swept, (jnp.asarray(0), sweep))
        return settled

    def _over(
        self,
        near: dict[Kind, Near],
        which: OfChunks,
        visit: Callable[[Chunk, Result], Result],
        begin: Result,
    ) -> Result:
        for kind, known in near.items():
            order = jnp.argsort(~which[kind])

            def visited(
                place: Array,
                found: Result,
                kind: Kind = kind,
                order: Array = order,
                known: Approach = known.approach,
            ) -> Result:
                number = order[place]
                approach = jax.tree.map(lambda each: chunk_slice(each, number), known)
                return visit(Chunk(kind, number, self.contact.pairs(kind, number), approach), found)

            begin = jax.lax.fori_loop(0, which[kind].sum(), visited, begin)
        return begin

    def _led(self, forces: Totals) -> Totals:
        return jax.tree.map(lambda v, p, f: v + p * f, self.velocity, self.push, forces)

    def _speed(self, chunk: Chunk, velocity: Totals) -> Component:
        """Rate of the distance [mm/ms]."""
        corners = self.contact.corners(chunk.pairs, velocity)
        return dot(separation(chunk.approach.weights, corners), chunk.approach.normal)

    def _share(self, chunk: Chunk, touch: Bool[Array, " pair"], shares: Totals) -> Totals:
        (of_nodes,), of_sides = shares
        weights = touch * jnp.abs(jnp.stack(chunk.approach.weights))
        of_nodes = of_nodes.at[chunk.pairs.nodes].add(weights, mode="promise_in_bounds")
        if self.contact.periodic:
            of_sides = of_sides + jnp.abs(_turns(chunk)) @ touch
        return [of_nodes], of_sides

    def _softness(
        self, chunk: Chunk, of_nodes: Float[Array, " node"], of_sides: Float[Array, "2"]
    ) -> Component:
        """Distance that a pair gains by a unit force on its shares of masses [mm/N]."""
        soft = sum(
            jnp.abs(weight) * of_nodes.at[chunk.pairs.nodes[corner]].get(mode="promise_in_bounds")
            for corner, weight in enumerate(chunk.approach.weights)
        )
        if self.contact.periodic:
            soft = soft + of_sides @ jnp.abs(_turns(chunk))
        return jnp.asarray(soft * chunk.approach.factor)


def contact_forces(
    contact: Contact,
    shape: Shape,
    velocity: Shape,
    push: Shape,
    time: Float[Array, ""],
    workspace: Workspace,
) -> tuple[Shape, Workspace]:
    """Forces of the barrier on nodes, L_x and L_y over a time, partly implicit, and the memory [N].

    ``velocity`` are the mean rates by all other forces, ``push`` their change by a unit force.
    """
    grid = shape.positions[0].shape
    pushed = [jnp.broadcast_to(each, grid).ravel() for each in push.positions]
    step = ContactStep(
        contact,
        (flat(shape.positions), shape.lengths),
        (flat(velocity.positions), velocity.lengths),
        (pushed, push.lengths),
        time,
    )
    ((x, y, z), sides), workspace = step.forces(workspace)
    return Shape((x.reshape(grid), y.reshape(grid), z.reshape(grid)), sides), workspace


def _turns(chunk: Chunk) -> Float[Array, "2 pair"]:
    """Sides L_x and L_y between the closest points of pairs, as images of each other."""
    return jnp.einsum("kp,akp->ap", jnp.stack(chunk.approach.weights), chunk.pairs.turns)


@materialised
def force_after(pairs: PairList, reached: Component, softness: Component) -> Component:
    """Force f of pairs at the distance reached + ``softness`` · f to which it brings them [N].

    ``reached`` is the distance without force. Newton's method for the excess converges
    monotonically from below: the force is at least as at the least distance.
    """
    used: Bool[Array, " pair"] = pairs.range_squared > 0
    span = jnp.where(used, pairs.range_squared, 1.0)
    least = jnp.where(used, pairs.least_squared, 1.0)
    begins = jnp.sqrt(least + span)
    touching = used & (reached < begins)
    # Of the distance gained, over distance and steepness.
    slope = 2 * softness * pairs.strength * span
    ratio = jnp.where(touching, begins - reached, 0.0) / jnp.maximum(slope * jnp.sqrt(least), 1e-30)
    excess = 2 / (2 + ratio + jnp.sqrt(ratio * (ratio + 4)))
    for _ in range(NEWTON_STEPS):
        distance = jnp.sqrt(least + span * excess)
        steep, change = steepness(excess)
        error = distance * (1 - slope * steep) - reached
        rise = span / (2 * distance) * (1 - slope * steep) - slope * distance * change
        excess = jnp.clip(excess - error / rise, 1e-12, 1.0)
    distance = jnp.sqrt(least + span * excess)
    return jnp.where(touching, pairs.force(distance, excess), 0.0)


@materialised
def _changed(
    pairs: PairList, reached: Component, softness: Component, before: Component
) -> tuple[Component, Component]:
    """Force of pairs and its change; in one stage, as reading a place twice copies the whole."""
    force = force_after(pairs, reached, softness)
    return force, force - before
