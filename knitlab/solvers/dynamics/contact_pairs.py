"""Search of the pairs of parts of a fabric that may come within reach of each other."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.model.contact_layers import TRIANGLES, ContactLayers
from knitlab.model.network import MeshShape
from knitlab.solvers.dynamics.closest_points import Kind, distance
from knitlab.solvers.dynamics.contact_cells import (
    CORNERS,
    CellCorners,
    CellPairs,
    CloseCells,
    Place,
    grid_cells,
    neighbours,
)

EDGES = np.array([[[0, 0], [0, 1]], [[0, 0], [1, 0]], [[0, 0], [1, 1]]])
"""Edges that a cell owns, by the steps (y, x) to their corners; its node is at [0, 0]."""
SPLIT: dict[Kind, int] = {"triangle": 1, "edges": 2}
"""Number of the first corner of the second part of a pair."""
MIN_MARGIN = 0.1  # of a list, over the shortest side of a cell
MAX_MARGIN = 0.5
FEW = 1.0  # pairs for each node that a list may have for the sake of a wider margin
BLOCK = 1024  # pairs of cells whose parts are compared together
UNFOLDED = 0.2  # approach after which neighbours may be folded, over a cell side
FRESH = 0.4  # part of their margin up to which close cells serve for a new list
PASS = 4096  # pairs of parts that are looked at together
PARALLEL = 1e-3  # squared sine between edges of unit length, below which they count as parallel


@dataclass(frozen=True, eq=False)
class Parts:
    """Pairs of parts of one kind, the closest first."""

    nodes: Int[np.ndarray, "4 pair"]  # numbers of their corners
    turns: Int[np.ndarray, "2 4 pair"]  # sides L_x, L_y from these to the images that are meant
    near: Bool[np.ndarray, " pair"]  # whether they are near each other on the grid
    parallel: Float[np.ndarray, " pair"]  # squared cross product of nearly parallel edges [mm⁴]
    gap: Float[np.ndarray, " pair"]  # distance beyond that at which their barrier begins [mm]

    def some(self, which: Int[np.ndarray, " some"]) -> "Parts":
        """Some of the pairs, by number."""
        columns = (self.nodes, self.turns, self.near, self.parallel, self.gap)
        return Parts(*(np.take(each, which, axis=-1) for each in columns))


class Candidates(NamedTuple):
    """Pairs of parts of one kind, by what owns them."""

    pair: Int[np.ndarray, " part"]  # number of the pair of cells
    which: Int[np.ndarray, " part"]  # parts of these
    near: Bool[np.ndarray, " part"]
    gap: Float[np.ndarray, " part"]  # [mm]


class Watched(NamedTuple):
    """Pairs of cells, and how far they may approach before some of their parts are not listed."""

    one: Int[Array, " pair"]  # number of the cell
    other: Int[Array, " pair"]
    turns: Float[Array, "2 pair"]  # sides L_x, L_y from one to the image of the other
    slack: Float[Array, " pair"]  # [mm]

    @classmethod
    def of(cls, pairs: CellPairs, slack: Float[np.ndarray, " pair"]) -> "Watched":
        """Pairs with their slack; few lengths of lists, so that few programs are compiled."""
        spare = 2 ** int(np.ceil(np.log2(max(len(slack), 1024)))) - len(slack)
        numbers = (np.pad(each, (0, spare)).astype(np.int32) for each in (pairs.one, pairs.other))
        turns = np.pad(pairs.turns.astype(float), ((0, 0), (0, spare)))
        slacks = np.pad(slack, (0, spare), constant_values=np.inf)
        return cls(*map(jnp.asarray, (*numbers, turns, slacks)))


@dataclass(frozen=True, eq=False)
class Listed:
    """The pairs that can come within reach before parts have approached by more than a margin."""

    place: Place  # where they were found
    parts: dict[Kind, Parts]
    cells: CloseCells
    watched: Watched


@dataclass(frozen=True)
class PairFinder:
    """Finds the pairs of a fabric of a mesh shape that can touch."""

    shape: MeshShape
    layers: ContactLayers

    def listed(self, place: Place, last: Listed | None = None, wanted: float = 0.0) -> Listed:
        """The pairs at a configuration, with a wide margin where few parts are close.

        Close cells are taken from the ``last`` list where they are still all. The margin is as
        ``wanted`` at least, if not wider than can be [mm].
        """
        margin = MAX_MARGIN * self.layers.cell
        least = min(max(MIN_MARGIN * self.layers.cell, wanted), margin)
        within = self.layers.far.begins + margin
        if last is None or not last.cells.spent(place) < FRESH:
            cells = CloseCells.at(self.shape, self.layers.cell, place, within)
        else:
            cells = last.cells
        of_cells = grid_cells(self.shape).corners(place)
        gap = cells.pairs.gaps(of_cells, place.lengths) - self.layers.far.begins
        beside, folded = neighbours(self.shape, of_cells)
        pairs = cells.pairs.some(np.flatnonzero(gap <= margin)).and_also(
            beside.some(np.flatnonzero(folded))
        )
        distances = _distances(pairs, of_cells, place)
        found = {kind: self._candidates(kind, pairs, distances[kind], margin) for kind in SPLIT}
        gaps = np.concatenate([each.gap for each in found.values()])
        few = int(FEW * self.shape.nodes)
        if len(gaps) > few:
            margin = max(least, float(np.partition(gaps, few)[few]))
        slack = np.concatenate([gap, np.where(folded, 0.0, UNFOLDED * self.layers.cell)])
        watched = Watched.of(cells.pairs.and_also(beside), np.maximum(slack, margin))
        parts = {kind: self._parts(kind, pairs, each, margin) for kind, each in found.items()}
        return Listed(place, parts, cells, watched)

    def used(self, listed: Listed, place: Place) -> float:
        """Part of its margins that a motion has used of a list; above 1 it may be incomplete."""
        motion = place.positions - listed.place.positions
        motion = motion.T.reshape(3, self.shape.nodes_y, self.shape.nodes_x)
        used = float(_used(motion, place.lengths - listed.place.lengths, listed.watched))
        spent = listed.cells.spent(place)
        return max(used, spent) if np.isfinite(used + spent) else np.inf

    def gaps(self, parts: dict[Kind, Parts], place: Place) -> dict[Kind, Float[np.ndarray, "pair"]]:
        """Gaps of pairs of parts elsewhere than where they were found [mm]."""
        begins = self.layers.far.begins, self.layers.near.begins
        return {
            kind: each - np.where(parts[kind].near, begins[1], begins[0])
            for kind, each in _of_parts(parts, place, _part_distances).items()
        }

    def _candidates(
        self,
        kind: Kind,
        pairs: CellPairs,
        distances: Float[np.ndarray, "which pair"],
        margin: float,
    ) -> Candidates:
        """Parts of one kind with gaps up to a margin, near or far if any corner is so."""
        which, pair = np.nonzero(distances <= self.layers.far.begins + margin)
        gap = distances[which, pair] - self.layers.far.begins
        found = Candidates(pair, which, np.zeros(len(pair), bool), gap)
        # Cells farther apart on the grid than these have parts that are far.
        most = self.layers.near_cells + 2
        rows, columns = np.clip(pairs.steps, -most, most) + most
        steps = which, rows[pair], columns[pair]
        some_near, some_far = _relations(kind, self.layers.near_cells)
        near = _some(found, some_near[steps])
        nearer = self.layers.far.begins - self.layers.near.begins
        near = near._replace(near=~near.near, gap=near.gap + nearer)
        near = _some(near, near.gap <= margin)
        both = zip(_some(found, some_far[steps]), near, strict=True)
        found = Candidates(*(np.concatenate(each) for each in both))
        if self.shape.periodic:
            return found
        outside = grid_cells(self.shape).outside
        at_edge = outside[2]  # the corner at [1, 1] is if any is
        doubtful = np.flatnonzero((at_edge[pairs.one] | at_edge[pairs.other])[found.pair])
        cells, corners = _owners(kind, pairs, _some(found, doubtful))
        exists = np.ones(len(found.pair), bool)
        exists[doubtful] = ~outside[corners, cells].any(axis=0)
        return _some(found, exists)

    def _parts(self, kind: Kind, pairs: CellPairs, found: Candidates, margin: float) -> Parts:
        """Those with gaps up to a margin."""
        found = _some(found, np.argsort(found.gap)[: np.count_nonzero(found.gap <= margin)])
        cells, corners = _owners(kind, pairs, found)
        nodes, turns, _ = grid_cells(self.shape)
        of_other = _OF_OTHER[kind][found.which].T
        images = turns[:, corners, cells] + pairs.turns[:, None, found.pair] * of_other
        parallel = PARALLEL * _SQUARES[kind][found.which]
        return Parts(nodes[corners, cells], images.astype(np.int8), found.near, parallel, found.gap)


def _some(
    found: Candidates, which: Int[np.ndarray, " some"] | Bool[np.ndarray, " part"]
) -> Candidates:
    return Candidates(*(each[which] for each in found))


def _owners(
    kind: Kind, pairs: CellPairs, found: Candidates
) -> tuple[Int[np.ndarray, "4 part"], Int[np.ndarray, "4 part"]]:
    """The cell that owns each corner of pairs of parts, and the corner of the cell."""
    one, other = (each[found.pair] for each in (pairs.one, pairs.other))
    return np.where(_OF_OTHER[kind][found.which].T, other, one), _CORNERS[kind][found.which].T


_STEPS: dict[Kind, Int[np.ndarray, "which 4 2"]] = {
    "triangle": np.array([[[0, 0], *triangle] for triangle in TRIANGLES] * 2),
    "edges": np.array([[*one, *other] for one in EDGES for other in EDGES]),
}
"""Steps to the corners of what two cells own, from the node of the cell that owns each."""
_OF_OTHER: dict[Kind, Bool[np.ndarray, "which 4"]] = {
    "triangle": np.array([[0, 1, 1, 1]] * 2 + [[1, 0, 0, 0]] * 2, bool),
    "edges": np.array([[0, 0, 1, 1]] * 9, bool),
}
"""Whether the second cell owns a corner; a node is of either, and the triangle of the other."""
_CORNERS: dict[Kind, Int[np.ndarray, "which 4"]] = {
    kind: (steps[:, :, None] == CORNERS).all(axis=-1).argmax(axis=-1)
    for kind, steps in _STEPS.items()
}


@cache
def _relations(
    kind: Kind, reach: int
) -> tuple[Bool[np.ndarray, "which row column"], Bool[np.ndarray, "which row column"]]:
    """Whether some corners of both parts are near each other, and whether some are far.

    By the rows and columns from the first cell to the second, up to two beyond ``reach``. Parts
    that share a corner are neither.
    """
    steps = _STEPS[kind] * np.where(_OF_OTHER[kind], 1, -1)[..., None]
    corners = steps[:, : SPLIT[kind], None] + steps[:, None, SPLIT[kind] :]
    cells = np.moveaxis(np.indices((2 * reach + 5,) * 2) - reach - 2, 0, -1)
    between = np.abs(cells[:, :, None, None] + corners[:, None, None]).max(axis=-1)
    apart = (between > 0).all(axis=(-1, -2))
    return (
        apart & (between <= reach).any(axis=(-1, -2)),
        apart & (between > reach).any(axis=(-1, -2)),
    )


_SQUARES: dict[Kind, Float[np.ndarray, " which"]] = {
    "triangle": np.zeros(4),
    "edges": ((_STEPS["edges"][:, 1::2] - _STEPS["edges"][:, ::2]) ** 2).sum(-1).prod(-1) * 1.0,
}
"""Product of the squared lengths of two edges, over the fourth power of a cell side."""


def _distances(
    pairs: CellPairs, of_cells: CellCorners, place: Place
) -> dict[Kind, Float[np.ndarray, "which pair"]]:
    """Distances between what the cells of pairs own [mm]."""
    count = len(pairs.one)
    spare = ((0, 0), (0, 0), (0, -count % BLOCK))
    one, other = (np.pad(each, spare) for each in pairs.corners(of_cells, place.lengths))
    found = [
        _cell_distances(one[..., start : start + BLOCK], other[..., start : start + BLOCK])
        for start in range(0, count, BLOCK)
    ]
    return {
        kind: np.concatenate(
            [np.zeros((len(_STEPS[kind]), 0)), *(block[kind] for block in found)], axis=1
        )[:, :count]
        for kind in SPLIT
    }


@jax.jit
def _cell_distances(
    one: Float[Array, "4 3 cell"], other: Float[Array, "4 3 cell"]
) -> dict[Kind, Float[Array, "which cell"]]:
    """Distances between what two cells own: the node of each and triangles, and edges [mm]."""

    def distances(kind: Kind) -> list[Array]:
        return [
            distance(
                jnp.stack([(other if of else one)[n] for n, of in zip(*own, strict=True)]), kind
            )
            for own in zip(_CORNERS[kind], _OF_OTHER[kind], strict=True)
        ]

    return {kind: jnp.stack(distances(kind)) for kind in SPLIT}


@jax.jit
def _used(
    motion: Float[Array, "3 row column"], stretch: Float[Array, "2"], watched: Watched
) -> Float[Array, ""]:
    """Largest part of their slack by which cells may have approached in a motion."""
    after = jnp.pad(motion, ((0, 0), (0, 1), (0, 1)), "edge")
    corners = jnp.stack([motion, after[:, :-1, 1:], after[:, 1:, 1:], after[:, 1:, :-1]])
    mean = corners.mean(axis=0)
    spread = jnp.sqrt(((corners - mean) ** 2).sum(axis=1).max(axis=0)).ravel()
    x, y, z = mean.reshape(3, -1)
    one = watched.one
    other = watched.other
    square = (
        (x[one] - x[other] - stretch[0] * watched.turns[0]) ** 2
        + (y[one] - y[other] - stretch[1] * watched.turns[1]) ** 2
        + (z[one] - z[other]) ** 2
    )
    return jnp.max((jnp.sqrt(square) + spread[one] + spread[other]) / watched.slack)


def approaches(parts: dict[Kind, Parts], motion: Place) -> dict[Kind, Float[np.ndarray, "pair"]]:
    """By how much pairs of parts may have approached in a motion, at most [mm]."""
    return _of_parts(parts, motion, _part_approaches)


def _of_parts(
    parts: dict[Kind, Parts], place: Place, function: Callable[..., Array]
) -> dict[Kind, Float[np.ndarray, " pair"]]:
    """A number of every pair of parts, by a function that takes some of them."""
    at = jnp.asarray(place.positions.T), jnp.asarray(place.lengths)
    numbers = {}
    for kind, each in parts.items():
        count = each.gap.size
        spare = -count % PASS
        nodes = np.pad(each.nodes, ((0, 0), (0, spare)))
        turns = np.pad(each.turns, ((0, 0), (0, 0), (0, spare)))
        found = [
            function(kind, *at, nodes[:, some], turns[..., some])
            for some in (slice(start, start + PASS) for start in range(0, count, PASS))
        ]
        numbers[kind] = np.concatenate([np.zeros(0), *found])[:count]
    return numbers


def _at_corners(
    positions: Float[Array, "3 node"],
    lengths: Float[Array, "2"],
    nodes: Int[Array, "4 pair"],
    turns: Int[Array, "2 4 pair"],
) -> Float[Array, "4 3 pair"]:
    at = positions[:, nodes].at[:2].add(lengths[:, None, None] * turns)
    return at.transpose(1, 0, 2)


@partial(jax.jit, static_argnums=0)
def _part_distances(kind: Kind, *of: Array) -> Float[Array, " pair"]:
    """Distances of pairs of parts [mm]."""
    return distance(_at_corners(*of), kind)


@partial(jax.jit, static_argnums=0)
def _part_approaches(kind: Kind, *of: Array) -> Float[Array, " pair"]:
    """Upper bounds of how far points of the parts move towards each other [mm]."""
    by_corner = _at_corners(*of)
    first, second = by_corner[: SPLIT[kind], None], by_corner[SPLIT[kind] :]
    return jnp.sqrt(((first - second) ** 2).sum(axis=2).max(axis=(0, 1)))
