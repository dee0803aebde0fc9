"""Search of the pairs of parts of a fabric that may come within reach of each other.

A grid cell owns its lower left node, the edges that start there and its two triangles, so that
every pair of parts belongs to one pair of cells, and is found once. Periodic fabric is compared
with itself, and with its images above and to the right: all other pairs are images of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.dynamics.contact import CHUNK, Contact, Kind, PairList, squared_distance
from knitlab.fabric.contact_layers import ContactLayers
from knitlab.fabric.network import MeshShape

NODE = np.array([[[0, 0]]])
EDGES = np.array([[[0, 0], [0, 1]], [[0, 0], [1, 0]], [[0, 0], [1, 1]]])
TRIANGLES = np.array([[[0, 0], [0, 1], [1, 1]], [[1, 1], [1, 0], [0, 0]]])
"""Node, edges and triangles that a cell owns, by the steps (y, x) to their corners."""
CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
NEIGHBOURS = np.array([[0, 1], [1, -1], [1, 0], [1, 1]])
"""Steps (y, x) to half of the neighbours of a cell, or of a period; the others mirror them."""
SPLIT = {"triangle": 1, "edges": 2}  # number of the first corner of the second part of a pair
MARGINS = 0.05, 0.5  # least and greatest margin of a list, over the shortest side of a cell
BLOCK = 2**14  # pairs whose distances are computed together
PARALLEL = 1e-3  # squared sine between edges of unit length, below which they count as parallel

Cells = Int[np.ndarray, "cell 2"]  # row and column of lower left nodes, images included
Pairs = Int[np.ndarray, "pair 4 2"]  # the same of the four corners
Positions = Float[np.ndarray, "node 3"]
Lengths = Float[np.ndarray, "2"]

_squared = jax.jit(squared_distance, static_argnames="kind")


@dataclass(frozen=True, eq=False)
class Parts:
    """Pairs of parts of one kind that are not too far apart."""

    corners: Pairs
    near: Bool[np.ndarray, " pair"]  # whether they are near each other on the grid
    gap: Float[np.ndarray, " pair"]  # distance beyond that at which their barrier begins [mm]

    def within(self, margin: float) -> "Parts":
        """Those with a gap of at most a margin."""
        which = self.gap <= margin
        return Parts(self.corners[which], self.near[which], self.gap[which])


@dataclass(frozen=True, eq=False)
class Listed:
    """The pairs that can come within reach before parts have approached by more than a margin."""

    positions: Positions  # at which they were found [mm]
    lengths: Lengths  # L_x and L_y then [mm]
    margin: float  # [mm]
    parts: dict[Kind, Parts]


@dataclass(frozen=True)
class PairFinder:
    """Finds the pairs of a fabric of a mesh shape that can touch."""

    shape: MeshShape
    layers: ContactLayers

    def listed(self, positions: Positions, lengths: Lengths) -> Listed:
        """The pairs at a configuration, with a wide margin where few parts are close."""
        least, margin = (fraction * self.layers.cell for fraction in MARGINS)
        parts = self._parts(positions, lengths, margin)
        gaps = np.concatenate([each.gap for each in parts.values()])
        few = self.shape.nodes // 4
        if len(gaps) > few:
            margin = max(least, float(np.partition(gaps, few)[few]))
        within = {kind: each.within(margin) for kind, each in parts.items()}
        return Listed(positions, lengths, margin, within)

    def margin_left(self, listed: Listed, positions: Positions, lengths: Lengths) -> float:
        """Margin that is left to a list after a motion [mm]; NaN if the motion is.

        Parts approach by the stretch of the fabric along x and y, and by all other motion.
        """
        if self.shape.periodic:
            plane = lengths / listed.lengths
        else:
            plane = np.ptp(positions[:, :2], axis=0) / np.ptp(listed.positions[:, :2], axis=0)
        motion = positions - listed.positions * [*plane, 1.0]
        motion -= (motion.min(axis=0) + motion.max(axis=0)) / 2
        nearer = 2 * float(np.sqrt(np.einsum("nc,nc->n", motion, motion).max()))
        begins = self.layers.far.begins
        return (begins + listed.margin) * min(float(plane.min()), 1.0) - nearer - begins

    def _parts(self, positions: Positions, lengths: Lengths, margin: float) -> dict[Kind, Parts]:
        one, other = self._close_cells(positions, lengths, self.layers.far.begins + margin)
        found = {}
        for kind, split in SPLIT.items():
            corners = np.concatenate(
                [_beside(self.shape, kind), _between(self.shape, one, other, kind)]
            )
            distance = self._distances(corners, positions, lengths, kind)
            apart = _apart_on_grid(corners, split)
            near = (apart <= self.layers.near_cells).any(axis=(1, 2))
            far = (apart > self.layers.near_cells).any(axis=(1, 2))
            of_layers = [
                Parts(
                    corners[which], np.full(which.sum(), layer is self.layers.near),
                    distance[which] - layer.begins,
                ).within(margin)
                for which, layer in ((far, self.layers.far), (near, self.layers.near))
            ]
            found[kind] = Parts(
                *(
                    np.concatenate([getattr(each, name) for each in of_layers])
                    for name in ("corners", "near", "gap")
                )
            )
        return found

    def _close_cells(
        self, positions: Positions, lengths: Lengths, within: float
    ) -> tuple[Cells, Cells]:
        """Pairs of cells whose boxes are within a distance [mm], but for neighbours."""
        cells, own = _cells(self.shape), len(_cells(self.shape))
        low, high = self._boxes(cells, positions, lengths)
        if self.shape.periodic:
            # Images whose boxes may come near those of the fabric.
            inner, outer = low.min(axis=0) - within, high.max(axis=0) + within
            for period in NEIGHBOURS:
                shift = np.array([*(period * lengths[::-1])[::-1], 0.0])
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
        one, other = one[which], other[which]
        gap = np.maximum(np.maximum(low[one] - high[other], low[other] - high[one]), 0.0)
        close = np.einsum("pc,pc->p", gap, gap) <= within**2
        return cells[one[close]], cells[other[close]]

    def _boxes(
        self, cells: Cells, positions: Positions, lengths: Lengths
    ) -> tuple[Float[np.ndarray, "cell 3"], Float[np.ndarray, "cell 3"]]:
        """Lowest and highest coordinates of cells [mm]."""
        corners = cells[:, None] + CORNERS
        if not self.shape.periodic:
            corners = np.minimum(corners, [self.shape.cells_y, self.shape.cells_x])
        nodes, turns = _nodes_and_turns(self.shape, corners)
        at = positions[nodes]
        at[..., :2] += turns[..., ::-1] * lengths
        return at.min(axis=1), at.max(axis=1)

    def _distances(
        self, corners: Pairs, positions: Positions, lengths: Lengths, kind: Kind
    ) -> Float[np.ndarray, " pair"]:
        """Distances of pairs [mm]."""
        nodes, turns = _nodes_and_turns(self.shape, corners)
        at = positions[nodes]
        if self.shape.periodic:
            at[..., :2] += turns[..., ::-1] * lengths
        count = len(at)
        at = np.concatenate([at, np.zeros((-count % BLOCK, 4, 3))]).transpose(1, 2, 0)
        blocks = [
            _squared(jnp.asarray(at[..., start : start + BLOCK]), kind=kind)
            for start in range(0, at.shape[-1], BLOCK)
        ]
        return np.sqrt(np.concatenate([*blocks, np.zeros(0)])[:count])


def contact_of_batch(finders: Sequence[PairFinder], listed: Sequence[Listed]) -> Contact:
    """The contact of a batch of fabrics of one mesh shape, in lists of one length."""
    shape = finders[0].shape
    lists, chunks = {}, []
    for kind in SPLIT:
        longest = max(len(each.parts[kind].gap) for each in listed)
        chunks.append(-(-longest // CHUNK))
        # Lengths are powers of two, so that few programs are compiled.
        places = CHUNK * 2 ** max(int(np.ceil(np.log2(max(chunks[-1], 1)))), 2)
        each = [
            _pair_list(shape, finder.layers, pairs, kind, places)
            for finder, pairs in zip(finders, listed, strict=True)
        ]
        lists[kind] = jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *each)
    return Contact(lists["triangle"], lists["edges"], jnp.asarray(chunks), shape.periodic)


def _pair_list(
    shape: MeshShape, layers: ContactLayers, listed: Listed, kind: Kind, places: int
) -> PairList:
    parts = listed.parts[kind]
    count, spare = len(parts.gap), places - len(parts.gap)
    nodes, turns = _nodes_and_turns(shape, parts.corners)
    near, far = layers.near, layers.far
    spare_corners = np.tile([[0], [1], [0], [1]], spare)  # an edge with itself, of some length
    parallel = np.zeros(count)
    if kind == "edges":
        squares = ((parts.corners[:, 1::2] - parts.corners[:, ::2]) ** 2).sum(axis=-1)
        parallel = PARALLEL * squares.prod(axis=1)

    def by_layer(name: str, spare_value: float = 0.0) -> Float[np.ndarray, " place"]:
        values = np.where(parts.near, getattr(near, name), getattr(far, name))
        return np.pad(values, (0, spare), constant_values=spare_value)

    return PairList(
        nodes=np.concatenate([nodes.T, spare_corners], axis=1).astype(np.int32),
        turns=np.pad(turns.transpose(2, 1, 0)[::-1], ((0, 0), (0, 0), (0, spare))).astype(np.int8),
        least_squared=by_layer("least") ** 2,
        range_squared=by_layer("range_squared", -1.0),
        strength=by_layer("strength"),
        parallel=np.pad(parallel, (0, spare), constant_values=1.0),
    )


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


def _between(shape: MeshShape, one: Cells, other: Cells, kind: Kind) -> Pairs:
    """Pairs of what two cells own."""
    if kind == "edges":
        return _products(shape, one, EDGES, other, EDGES)
    return np.concatenate(
        [_products(shape, one, NODE, other, TRIANGLES), _products(shape, other, NODE, one, TRIANGLES)]
    )


def _products(
    shape: MeshShape,
    one: Cells,
    parts: Int[np.ndarray, "part corner 2"],
    other: Cells,
    other_parts: Int[np.ndarray, "part corner 2"],
) -> Pairs:
    """Every part of one cell with every part of another, of those that exist."""
    steps = np.array([[*a, *b] for a in parts for b in other_parts])
    split = parts.shape[1]
    corners = np.repeat(one[:, None, None], len(steps), axis=1) + steps[:, :split]
    others = np.repeat(other[:, None, None], len(steps), axis=1) + steps[:, split:]
    pairs = np.concatenate([corners, others], axis=2).reshape(-1, 4, 2)
    if shape.periodic:
        return pairs
    return pairs[(pairs < [shape.nodes_y, shape.nodes_x]).all(axis=(1, 2))]


@lru_cache(maxsize=8)
def _beside(shape: MeshShape, kind: Kind) -> Pairs:
    """Pairs of what neighbouring cells own, without those that share a corner."""
    cells = _cells(shape)
    own = np.repeat(cells, len(NEIGHBOURS), axis=0)
    pairs = _between(shape, own, np.tile(NEIGHBOURS, (len(cells), 1)) + own, kind)
    if not shape.periodic:
        pairs = pairs[(pairs >= 0).all(axis=(1, 2))]
    return pairs[(_apart_on_grid(pairs, SPLIT[kind]) > 0).all(axis=(1, 2))]


def _apart_on_grid(pairs: Pairs, split: int) -> Int[np.ndarray, "pair corner corner"]:
    """Rows or columns, whichever are more, between the corners of both parts of pairs."""
    steps = pairs[:, :split, None] - pairs[:, None, split:]
    return np.abs(steps).max(axis=-1)
