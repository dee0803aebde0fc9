"""Forces of contact over one step in time, partly implicit.

The barrier is too stiff for explicit steps: every pair finds its force at the distance to which the
step leads, with its share of the mass of a node (mass splitting: Tonge, Benevolenski and
Voroshilov, ACM Trans. Graph. 31, 2012). Forces at the present distances come first, in collisions
only as far as they are stable; in each sweep every pair then finds its force given those of the
others, until none changes. With one sweep, pressed folds would close.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from knitlab.solvers.dynamics.closest_points import Kind, separation
from knitlab.solvers.dynamics.contact_potential import (
    Approach,
    Chunk,
    Contact,
    PairList,
    Result,
    Totals,
    chunk_size,
    chunk_slice,
    flat,
    nothing,
    steepness,
)
from knitlab.solvers.dynamics.grid import Shape
from knitlab.solvers.dynamics.vectors import Component, dot, materialised

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
