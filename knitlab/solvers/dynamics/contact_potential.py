"""The barrier of listed pairs in JAX: its energy, its derivatives, and how each pair lies.

The potential is that of :mod:`knitlab.solvers.equilibrium.contact_barrier`, so that a motion comes
to rest where equilibria are. Pairs of parts come from ``contact_pairs.py``, in lists with spare
places that are read in chunks: one program serves many lengths.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from knitlab.solvers.dynamics.closest_points import (
    CLOSEST,
    Corners,
    Kind,
    Weights,
    crossing,
    separation,
)
from knitlab.solvers.dynamics.vectors import Component, Vector, dot, materialised, scale

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

    def energy_and_gradient(
        self, positions: Vector, lengths: Float[Array, "2"]
    ) -> tuple[Float[Array, ""], Vector, Float[Array, "2"]]:
        """Energy of the barrier [N mm] and its derivatives by positions and by L_x and L_y [N].

        Finite also where parts are nearer than they may be.
        """
        place = flat(positions), lengths

        def added(chunk: Chunk, found: tuple[Array, Totals]) -> tuple[Array, Totals]:
            energy, totals = found
            _, _, pairs, (_, _, distance, excess, factor) = chunk
            stored = pairs.stored(excess)
            totals = self.add(chunk, -pairs.force(distance, excess) * factor, totals)
            return energy + jnp.sum(factor * stored), self.add_twist(chunk, stored, place, totals)

        energy, ((x, y, z), sides) = self.over_chunks(place, added, (jnp.zeros(()), nothing(place)))
        grid = positions[0].shape
        return energy, (x.reshape(grid), y.reshape(grid), z.reshape(grid)), sides

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
