"""Search of the pairs of parts of a fabric that may come within reach of each other.

A grid cell owns its lower left node, the edges that start there and its two triangles, so that
every pair of parts belongs to one pair of cells, and is found once. Periodic fabric is compared
with itself and with its images above and to the right: other pairs are images of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.model.contact_layers import TRIANGLES, ContactLayers
from knitlab.model.network import MeshShape
from knitlab.solvers.dynamics.contact_forces import Contact, Kind, PairList, chunk_size, distance
from knitlab.solvers.dynamics.grid import Shape

EDGES = np.array([[[0, 0], [0, 1]], [[0, 0], [1, 0]], [[0, 0], [1, 1]]])
"""Edges that a cell owns, by the steps (y, x) to their corners; its node is at [0, 0]."""
CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
NEIGHBOURS = np.array([[0, 1], [1, -1], [1, 0], [1, 1]])
"""Steps (y, x) to half of the neighbours of a cell, or of a period; the others mirror them."""
SPLIT: dict[Kind, int] = {"triangle": 1, "edges": 2}
"""Number of the first corner of the second part of a pair."""
MIN_MARGIN = 0.1  # of a list, over the shortest side of a cell
MAX_MARGIN = 0.5
PLACES = 4  # of a list at least, for each node
BLOCK = 1024  # pairs of cells whose parts are compared together
UNFOLDED = 0.2  # approach after which neighbours may be folded, over a cell side
CLOSE = 0.5  # distance beyond that of listed pairs up to which cells are close, over a cell side
MAX_BLOCKS = 256  # into which a grid is divided, about
FRESH = 0.4  # part of their margin up to which close cells serve for a new list
PARALLEL = 1e-3  # squared sine between edges of unit length, below which they count as parallel

Cells = Int[np.ndarray, "cell 2"]  # row and column of lower left nodes, images included
Pairs = Int[np.ndarray, "pair 4 2"]  # the same of the four corners
Positions = Float[np.ndarray, "node 3"]
Lengths = Float[np.ndarray, "2"]
Boxes = Float[np.ndarray, "3 cell"]


@dataclass(frozen=True, eq=False)
class Parts:
    """Pairs of parts of one kind that are not too far apart."""

    corners: Pairs
    near: Bool[np.ndarray, " pair"]  # whether they are near each other on the grid
    gap: Float[np.ndarray, " pair"]  # distance beyond that at which their barrier begins [mm]

    def within(self, margin: float) -> "Parts":
        """Those with a gap of at most a margin, the closest first."""
        which = np.argsort(self.gap)[: np.count_nonzero(self.gap <= margin)]
        return Parts(self.corners[which], self.near[which], self.gap[which])


@dataclass(frozen=True, eq=False)
class Place:
    """Where the nodes of a fabric are."""

    positions: Positions  # [mm]
    lengths: Lengths  # L_x and L_y [mm]


@dataclass(frozen=True, eq=False)
class CloseCells:
    """Pairs of cells, but for neighbours, that were within a distance of each other."""

    place: Place
    within: float  # [mm]
    between: Float[np.ndarray, "block block"]  # least distance of others, by their blocks [mm]
    one: Cells
    other: Cells

    def gaps(
        self, shape: MeshShape, low: Boxes, high: Boxes, lengths: Lengths
    ) -> Float[np.ndarray, " pair"]:
        """Gaps between the boxes of pairs of cells, whose lowest and highest corners are given."""
        one, turns = _nodes_and_turns(shape, self.one)
        other, others = _nodes_and_turns(shape, self.other)
        squared = np.zeros(len(one))
        for axis in range(3):
            shift = 0.0
            if shape.periodic and axis < 2:
                shift = (others - turns)[:, 1 - axis] * lengths[axis]
            ahead = low[axis][other] + shift - high[axis][one]
            behind = low[axis][one] - high[axis][other] - shift
            squared += np.maximum(np.maximum(ahead, behind), 0.0) ** 2
        return np.sqrt(squared)


class Watched(NamedTuple):
    """Pairs of cells, and how far they may approach before some of their parts are not listed."""

    one: Int[Array, " pair"]  # number of the cell
    other: Int[Array, " pair"]
    turns: Float[Array, "2 pair"]  # sides L_x, L_y between the images that are compared
    slack: Float[Array, " pair"]  # [mm]


@dataclass(frozen=True, eq=False)
class Listed:
    """The pairs that can come within reach before parts have approached by more than a margin."""

    place: Place  # where they were found
    margin: float  # [mm]
    parts: dict[Kind, Parts]
    cells: CloseCells
    watched: Watched

    def within(self, used: float) -> dict[Kind, int]:
        """How many of the first pairs can be within reach, by the used part of the margin."""
        reach = used * self.margin
        return {kind: int((each.gap <= reach).sum()) for kind, each in self.parts.items()}


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
        if last is None or not self._spent(last.cells, place) < FRESH:
            cells = self._close_cells(place, within + CLOSE * self.layers.cell)
        else:
            cells = last.cells
        parts, watched = self._parts(cells, place, margin)
        gaps = np.concatenate([each.gap for each in parts.values()])
        few = self.shape.nodes // 4
        if len(gaps) > few:
            margin = max(least, float(np.partition(gaps, few)[few]))
        one, other, slack = watched
        watch = self._watched(one, other, np.maximum(slack, margin))
        within_margin = {kind: each.within(margin) for kind, each in parts.items()}
        return Listed(place, margin, within_margin, cells, watch)

    def used(self, listed: Listed, place: Place) -> float:
        """Part of its margins that a motion has used of a list; above 1 it may be incomplete."""
        motion = place.positions - listed.place.positions
        motion = motion.T.reshape(3, self.shape.nodes_y, self.shape.nodes_x)
        used = float(_used(motion, place.lengths - listed.place.lengths, listed.watched))
        spent = self._spent(listed.cells, place)
        return max(used, spent) if np.isfinite(used + spent) else np.inf

    def _spent(self, cells: CloseCells, place: Place) -> float:
        """Part of their margin by which cells that are not close may have approached."""
        before = cells.place
        if self.shape.periodic:
            plane = place.lengths / before.lengths
        else:
            spans = (np.ptp(each.positions[:, :2], axis=0) for each in (place, before))
            plane = np.divide(*spans)
        motion = place.positions - before.positions * [*plane, 1.0]
        low, high = blocks(self.shape, motion)
        nearer = np.zeros_like(cells.between)
        for axis in range(3):
            spread = high[:, None, axis] - low[None, :, axis]
            nearer += np.maximum(spread, spread.T) ** 2
        left = cells.between * min(float(plane.min()), 1.0) - np.sqrt(nearer)
        return float((cells.within - left).max()) / (CLOSE * self.layers.cell)

    def _watched(self, one: Cells, other: Cells, slack: Float[np.ndarray, " pair"]) -> Watched:
        spare = 2 ** int(np.ceil(np.log2(max(len(one), 1024)))) - len(one)
        number, turns = _nodes_and_turns(self.shape, one)
        other_number, other_turns = _nodes_and_turns(self.shape, other)
        turns = np.pad((turns - other_turns)[:, ::-1].T.astype(float), ((0, 0), (0, spare)))
        numbers = (np.pad(each, (0, spare)).astype(np.int32) for each in (number, other_number))
        return Watched(
            *map(jnp.asarray, (*numbers, turns, np.pad(slack, (0, spare), constant_values=np.inf)))
        )

    def _parts(
        self, cells: CloseCells, place: Place, margin: float
    ) -> tuple[dict[Kind, Parts], tuple[Cells, Cells, Float[np.ndarray, " pair"]]]:
        """Pairs with gaps up to a margin, and the cells that could come close, with their slack."""
        at = self._corners(_cells(self.shape), place)
        gap = cells.gaps(self.shape, at.min(axis=0), at.max(axis=0), place.lengths)
        gap -= self.layers.far.begins
        close = gap <= margin
        *beside, folded = self._neighbours(place)
        watched = (
            np.concatenate([cells.one, beside[0]]),
            np.concatenate([cells.other, beside[1]]),
            np.concatenate([gap, np.where(folded, 0.0, UNFOLDED * self.layers.cell)]),
        )
        beside = [each[folded] for each in beside]
        cell = np.concatenate([cells.one[close], beside[0]])
        cell_other = np.concatenate([cells.other[close], beside[1]])
        distances = self._distances(cell, cell_other, place)
        found: dict[Kind, Parts] = {
            kind: self._near_parts(kind, cell, cell_other, distances[kind], margin)
            for kind in SPLIT
        }
        return found, watched

    def _near_parts(
        self,
        kind: Kind,
        one: Cells,
        other: Cells,
        distances: Float[np.ndarray, "pair cell"],
        margin: float,
    ) -> Parts:
        """Pairs of one kind with gaps up to a margin, near or far if any corner is so."""
        number, which = np.nonzero(self.layers.far.begins + margin >= distances.T)
        distance = distances[which, number]
        first = one[number]
        second = other[number]
        if kind == "triangle":  # the node of the first cell, or of the second
            swap = (which >= 2)[:, None]
            first, second = np.where(swap, second, first), np.where(swap, first, second)
            which = which % 2
        split = SPLIT[kind]
        corners = _STEPS[kind][which]
        corners[:, :split] += first[:, None]
        corners[:, split:] += second[:, None]
        # Rows or columns, whichever are more, between the corners of both parts.
        steps_between = np.abs(corners[:, :split, None] - corners[:, None, split:]).max(axis=-1)
        exist = (steps_between > 0).all(axis=(1, 2))
        if not self.shape.periodic:
            inside = (corners >= 0) & (corners < [self.shape.nodes_y, self.shape.nodes_x])
            exist &= inside.all(axis=(1, 2))
        found = []
        for near, layer in ((False, self.layers.far), (True, self.layers.near)):
            those = exist & ((steps_between <= self.layers.near_cells) == near).any(axis=(1, 2))
            gap = distance[those] - layer.begins
            found.append(Parts(corners[those], np.full(len(gap), near), gap).within(margin))
        far, close = found
        return Parts(
            np.concatenate([far.corners, close.corners]),
            np.concatenate([far.near, close.near]),
            np.concatenate([far.gap, close.gap]),
        )

    def _close_cells(self, place: Place, within: float) -> CloseCells:
        """Pairs of cells whose boxes are within a distance [mm], but for neighbours."""
        cells = _cells(self.shape)
        own = len(cells)
        at = self._corners(cells, place)
        low = at.min(axis=0).T
        high = at.max(axis=0).T
        if self.shape.periodic:
            # Images whose boxes may come near those of the fabric.
            inner = low.min(axis=0) - within
            outer = high.max(axis=0) + within
            for period in NEIGHBOURS:
                shift = np.array([*(period[::-1] * place.lengths), 0.0])
                reaches = ((low[:own] + shift <= outer) & (high[:own] + shift >= inner)).all(axis=1)
                image = period * [self.shape.cells_y, self.shape.cells_x]
                cells = np.concatenate([cells, cells[:own][reaches] + image])
                low = np.concatenate([low, low[:own][reaches] + shift])
                high = np.concatenate([high, high[:own][reaches] + shift])
        size = high - low
        # Boxes can only be so close if their centres are, in units of the largest box.
        scaled = (low + high) / 2 / (size.max(axis=0) + within)
        one, other = cKDTree(scaled).query_pairs(1.0, p=np.inf, output_type="ndarray").T
        which = (one < own) | (other < own)
        which &= np.abs(cells[one] - cells[other]).max(axis=1) > 1
        one = one[which]
        other = other[which]
        gap = np.maximum(np.maximum(low[one] - high[other], low[other] - high[one]), 0.0)
        close = np.einsum("pc,pc->p", gap, gap) <= within**2
        return CloseCells(
            place, within, self._between(place, within), cells[one[close]], cells[other[close]]
        )

    def _between(self, place: Place, within: float) -> Float[np.ndarray, "block block"]:
        """Least distances of cells of two blocks that are not within a distance [mm]."""
        low, high = blocks(self.shape, place.positions)
        if self.shape.periodic:
            return np.full((len(low), len(low)), within)  # their images may be nearer
        gaps = np.maximum(low[:, None] - high, (low[:, None] - high).transpose(1, 0, 2))
        return np.maximum(np.linalg.norm(gaps.clip(0.0), axis=-1), within)

    def _neighbours(self, place: Place) -> tuple[Cells, Cells, Bool[np.ndarray, " pair"]]:
        """Pairs of neighbouring cells, and whether they fold by more than a right angle."""
        cells = _cells(self.shape)
        at = self._corners(cells, place)
        normals = np.cross((at[2] - at[0]).T, (at[3] - at[1]).T)
        one, other = _beside(self.shape)
        numbers = (_nodes_and_turns(self.shape, each)[0] for each in (one, other))
        against = np.einsum("nc,nc->n", *(normals[number] for number in numbers))
        return one, other, against <= 0

    def _corners(self, cells: Cells, place: Place) -> Float[np.ndarray, "4 3 cell"]:
        """Positions of the corners of cells; beyond an edge those of the edge [mm]."""
        corners = (cells[:, None] + CORNERS).transpose(1, 0, 2)
        if not self.shape.periodic:
            corners = np.minimum(corners, [self.shape.cells_y, self.shape.cells_x])
            return place.positions[
                corners[..., 0] * self.shape.nodes_x + corners[..., 1]
            ].transpose(0, 2, 1)
        nodes, turns = _nodes_and_turns(self.shape, corners)
        at = place.positions[nodes]
        at[..., :2] += turns[..., ::-1] * place.lengths
        return at.transpose(0, 2, 1)

    def _distances(
        self, one: Cells, other: Cells, place: Place
    ) -> dict[Kind, Float[np.ndarray, "pair cell"]]:
        count = len(one)
        spare = -count % BLOCK
        at = [
            np.pad(self._corners(cells, place), ((0, 0), (0, 0), (0, spare)))
            for cells in (one, other)
        ]
        blocks = [
            _cell_distances(*(each[..., start : start + BLOCK] for each in at))
            for start in range(0, count, BLOCK)
        ]
        if not blocks:
            return {"triangle": np.zeros((4, 0)), "edges": np.zeros((9, 0))}
        return {
            kind: np.concatenate([np.asarray(block[kind]) for block in blocks], axis=1)[:, :count]
            for kind in SPLIT
        }


@lru_cache(maxsize=8)
def _beside(shape: MeshShape) -> tuple[Cells, Cells]:
    cells = _cells(shape)
    one = np.repeat(cells, len(NEIGHBOURS), axis=0)
    other = one + np.tile(NEIGHBOURS, (len(cells), 1))
    if shape.periodic:
        return one, other
    inside = ((other >= 0) & (other < [shape.nodes_y, shape.nodes_x])).all(axis=1)
    return one[inside], other[inside]


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
        (x[one] - x[other] + stretch[0] * watched.turns[0]) ** 2
        + (y[one] - y[other] + stretch[1] * watched.turns[1]) ** 2
        + (z[one] - z[other]) ** 2
    )
    return jnp.max((jnp.sqrt(square) + spread[one] + spread[other]) / watched.slack)


_STEPS: dict[Kind, Int[np.ndarray, "pair 4 2"]] = {
    "triangle": np.array([[[0, 0], *triangle] for triangle in TRIANGLES]),
    "edges": np.array([[*one, *other] for one in EDGES for other in EDGES]),
}
"""Steps to the corners of what two cells own, those of the first cell and those of the second."""


@jax.jit
def _cell_distances(
    one: Float[Array, "4 3 cell"], other: Float[Array, "4 3 cell"]
) -> dict[Kind, Float[Array, "pair cell"]]:
    """Distances between what two cells own: the node of each and triangles, and edges [mm]."""
    place = {(int(y), int(x)): number for number, (y, x) in enumerate(CORNERS)}

    def distances(kind: Kind, first: Array, second: Array) -> list[Array]:
        split = SPLIT[kind]
        found = []
        for steps in _STEPS[kind]:
            numbers = [place[int(y), int(x)] for y, x in steps]
            corners = jnp.stack(
                [first[n] if i < split else second[n] for i, n in enumerate(numbers)]
            )
            found.append(distance(corners, kind))
        return found

    return {
        "triangle": jnp.stack(
            distances("triangle", one, other) + distances("triangle", other, one)
        ),
        "edges": jnp.stack(distances("edges", one, other)),
    }


def batch_contact(finders: Sequence[PairFinder], listed: Sequence[Listed]) -> Contact:
    """The contact of a batch of fabrics of one mesh shape, in lists of one length."""
    shape = finders[0].shape
    lists: dict[Kind, PairList] = {}
    # Few lengths, so that few programs are compiled.
    places = 2 ** int(np.ceil(np.log2(max(PLACES * shape.nodes, chunk_size()))))
    while places < max(len(pairs.gap) for each in listed for pairs in each.parts.values()):
        places *= 4
    for kind in SPLIT:
        each = [
            _pair_list(shape, finder.layers, pairs, kind, places)
            for finder, pairs in zip(finders, listed, strict=True)
        ]
        lists[kind] = jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)
    chunks = chunk_counts([each.within(1.0) for each in listed])
    return Contact(lists, chunks, shape.periodic)


def chunk_counts(pairs: Sequence[dict[Kind, int]]) -> dict[Kind, Int[Array, ""]]:
    """Chunks that hold the first pairs of every fabric of a batch, by how many these are."""
    return {
        kind: jnp.asarray(-(-max(each[kind] for each in pairs) // chunk_size())) for kind in SPLIT
    }


def _pair_list(
    shape: MeshShape, layers: ContactLayers, listed: Listed, kind: Kind, places: int
) -> PairList:
    parts = listed.parts[kind]
    count = len(parts.gap)
    spare = places - len(parts.gap)
    nodes, turns = _nodes_and_turns(shape, parts.corners)
    near = layers.near
    far = layers.far
    spare_corners = np.tile([[0], [1], [0], [1]], spare)  # an edge with itself, of some length
    parallel = np.zeros(count)
    if kind == "edges":
        squares = ((parts.corners[:, 1::2] - parts.corners[:, ::2]) ** 2).sum(axis=-1)
        parallel = PARALLEL * squares.prod(axis=1)

    def layer_values(name: str, spare_value: float = 0.0) -> Float[np.ndarray, " place"]:
        values = np.where(parts.near, getattr(near, name), getattr(far, name))
        return np.pad(values, (0, spare), constant_values=spare_value)

    columns = (
        np.concatenate([nodes.T, spare_corners], axis=1).astype(np.int32),
        np.pad(turns.transpose(2, 1, 0)[::-1], ((0, 0), (0, 0), (0, spare))).astype(np.int8),
        layer_values("least") ** 2,
        layer_values("range_squared", -1.0),
        layer_values("strength"),
        np.pad(parallel, (0, spare), constant_values=1.0),
    )
    return PairList(*map(jnp.asarray, columns))


def blocks(
    shape: MeshShape, of_nodes: Float[np.ndarray, "node 3"]
) -> tuple[Float[np.ndarray, "block 3"], Float[np.ndarray, "block 3"]]:
    """Least and greatest vectors of the corners of cells in each block of the grid."""
    side = int(np.ceil(np.sqrt(shape.nodes / MAX_BLOCKS)))
    rows, columns = (np.arange(0, count, side) for count in (shape.nodes_y, shape.nodes_x))
    grid = of_nodes.reshape(shape.nodes_y, shape.nodes_x, 3)
    grid = np.pad(grid, ((0, 1), (0, 1), (0, 0)), "wrap" if shape.periodic else "edge")

    def reduced(function: np.ufunc) -> Float[np.ndarray, "block 3"]:
        along = function.reduceat(function(grid[:-1], grid[1:]), rows, axis=0)
        both = function.reduceat(function(along[:, :-1], along[:, 1:]), columns, axis=1)
        return both.reshape(-1, 3)

    return reduced(np.minimum), reduced(np.maximum)


def _nodes_and_turns(
    shape: MeshShape, grid: Int[np.ndarray, "*place 2"]
) -> tuple[Int[np.ndarray, "*place"], Int[np.ndarray, "*place 2"]]:
    """Numbers of nodes on the grid, and the periods (y, x) from each to the image that is meant."""
    turns, nodes = np.divmod(grid, [shape.nodes_y, shape.nodes_x])
    return nodes[..., 0] * shape.nodes_x + nodes[..., 1], turns


@lru_cache(maxsize=8)
def _cells(shape: MeshShape) -> Cells:
    """All cells, and beyond the last ones of a sample those that own what lies on its edges."""
    return np.indices((shape.nodes_y, shape.nodes_x)).reshape(2, -1).T


COVERED = 0.8  # part of its margins that a motion may use of a list, if it gains no speed
SPARE = 0.05  # part of margins up to which pairs are evaluated beyond what a motion may use
OLD = 0.1  # part used of a list that is worth a new one
STEPS = 20  # for which a list has margins at least

OfCases = Float[np.ndarray, " case"]


@dataclass(frozen=True, eq=False)
class ContactLists:
    """The lists of pairs that may touch in a batch of fabrics, one for each."""

    finders: Sequence[PairFinder]
    listed: Sequence[Listed]
    contact: Contact
    now: OfCases  # part that each fabric has used of the margins of its list
    most: OfCases  # part up to which pairs are evaluated that come within reach

    @classmethod
    def at(cls, finders: Sequence[PairFinder], shape: Shape) -> "ContactLists":
        """List the pairs of all fabrics."""
        places = zip(finders, _places(shape), strict=True)
        listed = [finder.listed(place) for finder, place in places]
        none = np.zeros(len(listed))
        return cls(finders, listed, batch_contact(finders, listed), none, none + 1.0)

    def used(self, shape: Shape) -> OfCases:
        """Part of the margins of its list that each fabric uses; above 1 the list is incomplete."""
        fabrics = zip(self.finders, self.listed, _places(shape), strict=True)
        return np.array([finder.used(listed, place) for finder, listed, place in fabrics])

    def covering(
        self, shape: Shape, velocity: Shape, step: OfCases, count: Int[np.ndarray, " case"]
    ) -> tuple["ContactLists", Int[np.ndarray, " case"]]:
        """Lists for some coming steps [ms], and as many of these as they cover, at least one."""
        duration = step * count

        def moved(at: jax.Array, rate: jax.Array) -> jax.Array:
            return at + duration.reshape(-1, *[1] * (at.ndim - 1)) * rate

        ahead: Shape = jax.tree.map(moved, shape, velocity)
        lists = self
        then = self.used(ahead)
        short = (then > COVERED) & (self.now > OLD)
        if short.any():
            fastest = np.max([np.abs(each).max(axis=(1, 2)) for each in velocity.positions], axis=0)
            lists = self._renewed(shape, short, 2 * STEPS * step * fastest)
            then = lists.used(ahead)
        part = np.clip((COVERED - lists.now) / np.maximum(then - lists.now, 1e-300), 0.0, 1.0)
        covered = np.where(count > 0, np.maximum(part * count, 1), 0).astype(int)
        expected = lists.now + np.maximum(then - lists.now, 0.0) * covered / np.maximum(count, 1)
        most = np.minimum(expected / COVERED + SPARE, 1.0)
        first = [each.within(part) for each, part in zip(lists.listed, most, strict=True)]
        contact = replace(lists.contact, chunks=chunk_counts(first))
        return replace(lists, contact=contact, most=most), covered

    def _renewed(
        self, shape: Shape, which: Bool[np.ndarray, " case"], margins: OfCases
    ) -> "ContactLists":
        """The same with new lists of some fabrics, of at least these margins [mm]."""
        fabrics = zip(self.finders, self.listed, which, _places(shape), margins, strict=True)
        listed = [
            finder.listed(place, old, margin) if new else old
            for finder, old, new, place, margin in fabrics
        ]
        contact = batch_contact(self.finders, listed)
        return replace(self, listed=listed, contact=contact, now=np.where(which, 0.0, self.now))


def _places(shape: Shape) -> list[Place]:
    positions = np.stack([np.asarray(each) for each in shape.positions], axis=-1)
    flat = positions.reshape(len(positions), -1, 3)
    return [Place(*place) for place in zip(flat, np.asarray(shape.lengths), strict=True)]
