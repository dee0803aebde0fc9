"""Contact of the fabric with itself: the barrier of :mod:`knitlab.fabric.barrier`, in JAX.

The potential is that of equilibria, so that a motion comes to rest where they are. It is a sum over
pairs of parts, a node and a triangle or two edges (Li et al., Incremental Potential Contact, ACM
Trans. Graph. 39, 2020), which :mod:`knitlab.dynamics.contact_pairs` lists. Lists have spare places
and are read in chunks, so that one program serves lists of many lengths.

In time, :meth:`Contact.forces`, the barrier is too stiff for explicit steps, so that every
pair takes the force at the distance to which the step leads.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from knitlab.dynamics.closest_points import CLOSEST, Corners, Kind, Weights, crossing, separation
from knitlab.dynamics.grid import Shape
from knitlab.dynamics.vectors import Component, Vector, dot, kept, scale

NEWTON_STEPS = 4  # for the force of a pair
# At most so many sweeps in which pairs take account of each other's forces, until these move them
# by this part of the distance at which their barriers begin.
SWEEPS, SETTLED = 24, 1e-3
# Excess over its range below which the force that a step begins with does not grow, and below which
# energies and their derivatives do not: in motion, parts may for a moment be nearer than the least.
DEEPEST, TOUCHING = 0.05, 1e-9
CALM = 0.25  # part of the range left to a pair that it may move by in a step, and count as at rest


def chunk() -> int:
    """Number of pairs that are evaluated together: few on a processor, where few act."""
    return 128 if jax.default_backend() == "cpu" else 1 << 14


OfNodes = list[Float[Array, " node"]]  # components along x, y and z
Totals = tuple[OfNodes, Float[Array, "2"]]  # of nodes, and of L_x and L_y
Forces = dict[Kind, Float[Array, " pair"]]  # of every pair of a list [N]
Acting = dict[Kind, Bool[Array, " chunk"]]  # whether any pair of a chunk acts


class PairList(NamedTuple):
    """Pairs of one kind that may come within reach, by their four corners.

    Places that are not used have a ``range_squared`` of −1.
    """

    # Of the corners, numbered along the rows of the grid.
    nodes: Int[Array, "*batch 4 pair"]
    # Sides L_x, L_y between a node and its image.
    turns: Int[Array, "*batch 2 4 pair"]
    # Square of the distance that parts keep [mm²].
    least_squared: Float[Array, "*batch pair"]
    # Square of the distance at which the barrier begins, less that of the least [mm²].
    range_squared: Float[Array, "*batch pair"]
    strength: Float[Array, "*batch pair"]  # of the barrier [N/mm³]
    # Squared cross product below which edges count as nearly parallel [mm⁴].
    parallel: Float[Array, "*batch pair"]


class Approach(NamedTuple):
    """How the parts of pairs lie to each other."""

    weights: Weights
    normal: Vector  # the direction in which they are apart
    distance: Component  # [mm]
    excess: Component  # of the squared distance over that of the least, by its range
    factor: Component  # by which nearly parallel edges count
    twist: Corners | None  # derivatives of this factor by the corners [1/mm]


class Sweep(NamedTuple):
    """Forces of pairs, the chunks in which they are not settled, and what is summed over pairs."""

    forces: Forces
    acting: Acting
    totals: Any


class Contact(eqx.Module):
    """All pairs that can come within reach before they are listed again."""

    lists: dict[Kind, PairList]
    # number of chunks that hold pairs, in any fabric of a batch
    chunks: dict[Kind, Int[Array, ""]]
    periodic: bool = eqx.field(static=True)

    def energy(self, positions: Vector, lengths: Float[Array, "2"]) -> Float[Array, ""]:
        """Energy of the barrier [N mm], finite where parts are nearer than they may be."""
        place = _flat(positions)

        def added(pairs: PairList, pair: Approach, total: Array) -> tuple[Array, bool]:
            return total + jnp.sum(pair.factor * _stored(pairs, pair.excess)), True

        return self._over_pairs(place, lengths, added, jnp.zeros(()))[0]

    def gradient(
        self, positions: Vector, lengths: Float[Array, "2"]
    ) -> tuple[Vector, Float[Array, "2"]]:
        """Derivatives of the energy by the positions of nodes and by L_x and L_y [N]."""
        place = _flat(positions)

        def added(pairs: PairList, pair: Approach, totals: Totals) -> tuple[Totals, bool]:
            force = _force(pairs, pair, pair.excess) * pair.factor
            totals = self._add(pairs, pair, -force, totals)
            return self._add_twist(pairs, pair, _stored(pairs, pair.excess), totals), True

        ((x, y, z), sides), _ = self._over_pairs(place, lengths, added, _nothing(place))
        grid = positions[0].shape
        return (x.reshape(grid), y.reshape(grid), z.reshape(grid)), sides

    def forces(
        self,
        shape: Shape,
        velocity: Shape,
        push: Shape,
        time: Float[Array, ""],
    ) -> Shape:
        """Forces of the barrier over a time, partly implicit [N].

        Every pair finds its own force, at the distance to which the motion leads. The mass of a
        node is shared among the pairs that act on it, so that many stiff pairs are stable together
        (mass splitting: Tonge, Benevolenski and Voroshilov, ACM Trans. Graph. 31, 2012). First come
        the forces at the present distances: whole where they balance the others, so that at rest
        nothing is added, and in collisions only as far as they are stable. In each sweep every pair
        then finds its force given those of the others, until no force changes. With one sweep,
        forces do not pass on from pair to pair, and pressed folds close.

        Args:
            shape: positions of nodes, L_x and L_y [mm].
            velocity: their mean rates over the time by all other forces [mm/ms].
            push: change of these by a unit force [mm/ms/N].
            time: for which the forces act [ms].

        Returns:
            The forces on nodes, L_x and L_y.
        """
        grid, lengths = shape.positions[0].shape, shape.lengths
        place, free = _flat(shape.positions), (_flat(velocity.positions), velocity.lengths)
        pushed = [jnp.broadcast_to(each, grid).ravel() for each in push.positions]
        side_push = push.lengths
        pushed_most = jnp.maximum(jnp.maximum(pushed[0], pushed[1]), pushed[2])

        def led(totals: Totals) -> Totals:
            """Mean rates over the time with forces."""
            nodes = [v + p * force for v, p, force in zip(free[0], pushed, totals[0], strict=True)]
            return nodes, velocity.lengths + side_push * totals[1]

        def present(pairs: PairList, pair: Approach) -> Component:
            """Force at the present distance [N]."""
            force = _force(pairs, pair, jnp.maximum(pair.excess, DEEPEST))
            return jnp.where(pairs.range_squared > 0, force, 0.0)

        def acts(pairs: PairList, pair: Approach) -> Bool[Array, " pair"]:
            ahead = pair.distance + time * self._speed(pairs, pair, free)
            near = ahead**2 < pairs.least_squared + pairs.range_squared
            return (pairs.range_squared > 0) & ((pair.excess < 1) | near)

        def told(pairs: PairList, pair: Approach, unused: None) -> tuple[None, Bool[Array, ""]]:
            return unused, acts(pairs, pair).any()

        _, acting = self._over_pairs(place, lengths, told, None)

        def shared(
            pairs: PairList, pair: Approach, force: Component, found: Any
        ) -> tuple[Component, bool, Any]:
            """Add present forces, and the pairs that share the mass of each node."""
            totals, share, side_share = found
            force, share_of = present(pairs, pair), acts(pairs, pair)
            totals = self._add(pairs, pair, force * pair.factor, totals)
            weights = share_of * jnp.abs(jnp.stack(pair.weights))
            share = share.at[pairs.nodes].add(weights, mode="promise_in_bounds")
            if self.periodic:
                side_share = side_share + jnp.abs(_turns(pairs, pair)) @ share_of
            return force, True, (totals, share, side_share)

        nothing = _nothing(place)
        unknown = {kind: jnp.zeros_like(each.strength) for kind, each in self.lists.items()}
        none = nothing, jnp.zeros_like(place[0]), jnp.zeros(2)
        begin = self._over_acting(place, lengths, shared, Sweep(unknown, acting, none))
        totals, share, side_share = begin.totals
        balanced = led(totals)
        of_nodes, of_sides = time * pushed_most * share, time * side_push * side_share

        def softness(pairs: PairList, pair: Approach) -> Component:
            """Distance that a pair gains by a unit force on its shares of masses [mm/N]."""
            soft = sum(
                jnp.abs(weight) * of_nodes.at[pairs.nodes[corner]].get(mode="promise_in_bounds")
                for corner, weight in enumerate(pair.weights)
            )
            if self.periodic:
                soft = soft + of_sides @ jnp.abs(_turns(pairs, pair))
            return jnp.asarray(soft * pair.factor)

        def first(pairs: PairList, pair: Approach) -> Component:
            """The present force, as far as it is stable if the pair is not at rest with it [N]."""
            left = jnp.maximum(_begins(pairs) - pair.distance, 0.0)
            calm = jnp.abs(time * self._speed(pairs, pair, balanced)) < CALM * left
            stable = left / jnp.maximum(softness(pairs, pair), 1e-30)
            force = present(pairs, pair)
            return jnp.where(calm, force, jnp.minimum(force, stable))

        def begun(
            pairs: PairList, pair: Approach, unused: Component, totals: Totals
        ) -> tuple[Component, bool, Totals]:
            force = first(pairs, pair)
            stored = _stored(pairs, jnp.maximum(pair.excess, DEEPEST))
            totals = self._add_twist(pairs, pair, -stored, totals)
            return force, True, self._add(pairs, pair, force * pair.factor, totals)

        begin = self._over_acting(place, lengths, begun, Sweep(begin.forces, acting, nothing))

        def unsettled(found: tuple[Int[Array, ""], Sweep]) -> Bool[Array, ""]:
            number, sweep = found
            acting = jnp.array([each.any() for each in sweep.acting.values()])
            return (number < SWEEPS) & acting.any()

        def swept(found: tuple[Int[Array, ""], Sweep]) -> tuple[Int[Array, ""], Sweep]:
            number, last = found
            ahead = led(last.totals)

            def corrected(
                pairs: PairList, pair: Approach, before: Component, totals: Totals
            ) -> tuple[Component, Bool[Array, ""], Totals]:
                soft = softness(pairs, pair)
                reached = pair.distance + time * self._speed(pairs, pair, ahead) - soft * before
                force = _force_after(pairs, reached, soft)
                moves = (soft * jnp.abs(force - before) > SETTLED * _begins(pairs)).any()
                return force, moves, self._add(pairs, pair, (force - before) * pair.factor, totals)

            return number + 1, self._over_acting(place, lengths, corrected, last)

        _, settled = jax.lax.while_loop(unsettled, swept, (jnp.asarray(0), begin))
        (x, y, z), sides = settled.totals
        return Shape((x.reshape(grid), y.reshape(grid), z.reshape(grid)), sides)

    def _over_pairs(
        self, place: OfNodes, lengths: Float[Array, "2"], visit: Any, begin: Any
    ) -> tuple[Any, Acting]:
        """What a function of pairs, of how they lie and of its last result returns at the end.

        The function also tells whether any of the pairs of a chunk act.
        """
        told: Acting = {}
        for kind in self.lists:

            def visited(number: Any, found: Any, kind: Kind = kind) -> Any:
                result, act = found
                result, acts = visit(*self._chunk(kind, number, place, lengths), result)
                return result, act.at[number].set(acts)

            none = jnp.zeros(self.lists[kind].strength.shape[-1] // chunk(), bool)
            begin, told[kind] = jax.lax.fori_loop(0, self.chunks[kind], visited, (begin, none))
        return begin, told

    def _over_acting(
        self, place: OfNodes, lengths: Float[Array, "2"], visit: Any, begin: Sweep
    ) -> Sweep:
        """Forces of pairs in the chunks that act, whether they act again, and the totals."""
        forces, acting, totals = dict(begin.forces), dict(begin.acting), begin.totals
        for kind in self.lists:
            order = jnp.argsort(~acting[kind])

            def visited(number: Any, found: Any, kind: Kind = kind, order: Any = order) -> Any:
                forces, acting, totals = found
                start = order[number] * chunk()
                own = jax.lax.dynamic_slice_in_dim(forces, start, chunk())
                pairs, pair = self._chunk(kind, order[number], place, lengths)
                own, again, totals = visit(pairs, pair, own, totals)
                forces = jax.lax.dynamic_update_slice_in_dim(forces, own, start, 0)
                return forces, acting.at[order[number]].set(again), totals

            begun = forces[kind], acting[kind], totals
            forces[kind], acting[kind], totals = jax.lax.fori_loop(
                0, acting[kind].sum(), visited, begun
            )
        return Sweep(forces, acting, totals)

    def _chunk(
        self, kind: Kind, number: Any, place: OfNodes, lengths: Float[Array, "2"]
    ) -> tuple[PairList, Approach]:
        """Some pairs of a list, and how they lie."""
        pairs = jax.tree.map(
            lambda each: jax.lax.dynamic_slice_in_dim(each, number * chunk(), chunk(), axis=-1),
            self.lists[kind],
        )
        return pairs, APPROACHES[kind](pairs, self._corners(pairs, place, lengths))

    def _corners(self, pairs: PairList, of_nodes: OfNodes, sides: Float[Array, "2"]) -> Corners:
        """Vectors at the corners of pairs, from those of the nodes and of a period."""
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

    def _speed(self, pairs: PairList, pair: Approach, velocity: Totals) -> Component:
        """Rate of the distance [mm/ms]."""
        return dot(separation(pair.weights, self._corners(pairs, *velocity)), pair.normal)

    def _add(self, pairs: PairList, pair: Approach, force: Component, totals: Totals) -> Totals:
        """Add forces that push the parts of pairs apart."""
        push = scale(force, pair.normal)
        by_corner = [jnp.stack([weight * each for weight in pair.weights]) for each in push]
        return self._scattered(pairs, by_corner, totals)

    def _add_twist(
        self, pairs: PairList, pair: Approach, force: Component, totals: Totals
    ) -> Totals:
        """Add forces along the derivatives of the factor of nearly parallel edges."""
        if pair.twist is None:
            return totals
        by_corner = [
            jnp.stack([force * corner[axis] for corner in pair.twist]) for axis in range(3)
        ]
        return self._scattered(pairs, by_corner, totals)

    def _scattered(self, pairs: PairList, by_corner: list[Array], totals: Totals) -> Totals:
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


def _flat(vector: Vector) -> OfNodes:
    return [each.ravel() for each in vector]


def _minus(vector: Vector) -> Vector:
    return -vector[0], -vector[1], -vector[2]


def _nothing(place: OfNodes) -> Totals:
    return [jnp.zeros_like(each) for each in place], jnp.zeros(2)


def _turns(pairs: PairList, pair: Approach) -> Float[Array, "2 pair"]:
    """Sides L_x and L_y between the closest points of pairs, as images of each other."""
    return jnp.einsum("kp,akp->ap", jnp.stack(pair.weights), pairs.turns)


def _approach(pairs: PairList, corners: Corners, kind: Kind) -> Approach:
    weights = CLOSEST[kind](corners)
    apart = separation(weights, corners)
    squared = dot(apart, apart)
    distance = jnp.sqrt(squared)
    normal = scale(1 / jnp.maximum(distance, 1e-300), apart)
    excess = (squared - pairs.least_squared) / pairs.range_squared
    excess = jnp.where(pairs.range_squared > 0, jnp.clip(excess, TOUCHING, 1.0), 1.0)
    if kind == "triangle":
        return Approach(weights, normal, distance, excess, jnp.ones_like(excess), None)
    crossed = crossing(corners)
    part = jnp.minimum(crossed.squared / pairs.parallel, 1.0)
    slope = 4 * (1 - part) / pairs.parallel
    first, second = scale(slope, crossed.by_first), scale(slope, crossed.by_second)
    twist = _minus(first), first, _minus(second), second
    return Approach(weights, normal, distance, excess, (2 - part) * part, twist)


APPROACHES = {kind: kept(partial(_approach, kind=kind)) for kind in CLOSEST}


def _begins(pairs: PairList) -> Component:
    """Distance at which the barrier of pairs begins [mm]."""
    return jnp.sqrt(jnp.abs(pairs.least_squared + pairs.range_squared))


def _stored(pairs: PairList, excess: Component) -> Component:
    """Energy of pairs by the excess of their squared distance over its range [N mm]."""
    return -pairs.strength * (pairs.range_squared * (1 - excess)) ** 2 * jnp.log(excess)


def _steepness(excess: Component) -> tuple[Component, Component]:
    """Decrease of the energy with the excess, over its scale, and the derivative of that."""
    left, logarithm = 1 - excess, jnp.log(excess)
    return (
        left * (left / excess - 2 * logarithm),
        2 * logarithm - left / excess * (4 + left / excess),
    )


def _force(pairs: PairList, pair: Approach, excess: Component) -> Component:
    """Force that pushes the parts of pairs apart [N]."""
    slope = 2 * pairs.strength * pairs.range_squared * _steepness(excess)[0]
    return pair.distance * slope


@kept
def _force_after(pairs: PairList, reached: Component, softness: Component) -> Component:
    """Force f of pairs at the distance reached + softness · f to which it brings them [N].

    ``reached`` is the distance without force [mm], and ``softness`` that gained by a unit force
    [mm/N]. Newton's method for the excess converges monotonically from below, where it begins: the
    force is at least as at the least distance.
    """
    used: Bool[Array, " pair"] = pairs.range_squared > 0
    span = jnp.where(used, pairs.range_squared, 1.0)
    least = jnp.where(used, pairs.least_squared, 1.0)
    begins = jnp.sqrt(least + span)
    touching = used & (reached < begins)
    slope = (
        2 * softness * pairs.strength * span
    )  # of the distance gained, over distance and steepness
    ratio = jnp.where(touching, begins - reached, 0.0) / jnp.maximum(slope * jnp.sqrt(least), 1e-30)
    excess = 2 / (2 + ratio + jnp.sqrt(ratio * (ratio + 4)))
    for _ in range(NEWTON_STEPS):
        distance = jnp.sqrt(least + span * excess)
        steep, change = _steepness(excess)
        error = distance * (1 - slope * steep) - reached
        rise = span / (2 * distance) * (1 - slope * steep) - slope * distance * change
        excess = jnp.clip(excess - error / rise, 1e-12, 1.0)
    distance = jnp.sqrt(least + span * excess)
    force = 2 * pairs.strength * span * distance * _steepness(excess)[0]
    return jnp.where(touching, force, 0.0)
