"""A pack: small fabrics of one mesh shape that are evaluated together.

A chunk of elements (:mod:`knitlab.elasticity.element_chunks`) takes as long half empty as full, so
that a fabric of few nodes wastes most of it. Here the elements of several fabrics fill the chunks,
one fabric after another. The fabrics may be at different stages of a continuation.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float

from knitlab.elasticity.element_chunks import (
    HEIGHTS,
    HINGES,
    SPRINGS,
    Stiffnesses,
    Vectors,
    chunk_hessians,
    chunk_incidence,
    element_energies,
)
from knitlab.elasticity.evaluation import ElementHessians, Evaluation, Stage
from knitlab.elasticity.hinge_stiffness import LANES, UNFOLDED
from knitlab.model.energy import Energy
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape, network
from knitlab.model.options import FoldAngle
from knitlab.model.shape_cache import cached_by_shape

LARGEST_PACK = 8
"""Largest number of fabrics in a pack."""
WORTH_PACKING = 0.4
"""Chunks of a packed fabric, over those of a fabric by itself, up to which packs pay off: fabrics
that take turns evict each other's factors from the cache."""
NEAR_LEAST = 1.05
"""A pack may take this much longer than the best one, if it is smaller."""

Point = tuple[Stage, Float[np.ndarray, " unknown"]]
"""Stage and configuration of a fabric."""
Parameters = tuple[tuple[float, Float[Array, " node"], Float[Array, " node"]], Stiffnesses]
"""Fraction of the rest angles, which is 1 because these are multiplied by it already, z_max and
wall stiffness of every node; rest values and stiffnesses of a chunk."""


def pack_size(nodes: int) -> int:
    """Number of fabrics of so many nodes that fill chunks well; 1 if packs do not pay off."""

    def chunks_each(fabrics: int) -> float:
        return -(-fabrics * nodes // HEIGHTS) / fabrics

    sizes = range(1, LARGEST_PACK + 1)
    least = min(map(chunks_each, sizes))
    if least > WORTH_PACKING * chunks_each(1):
        return 1
    return next(size for size in sizes if chunks_each(size) <= NEAR_LEAST * least)


KINDS = SPRINGS, HINGES, HEIGHTS
"""Springs, hinges and nodes in a chunk."""
ROWS = 3, 15, 1
"""Rows of the vectors of a spring, of those of a hinge, and of the height of a node."""
PADDING = np.ones((3, 1)), UNFOLDED.reshape(15, 1), np.zeros((1, 1))

Slots = Float[np.ndarray, "_ _"]
"""Rows by slots of all elements of one kind; the fabrics of a pack follow one another."""


@dataclass(frozen=True, eq=False)
class _Mesh:
    """Elements of one fabric of a pack.

    Attributes:
        counts: numbers of its springs, hinges and nodes.
        slots: numbers of slots that it takes for them: blocks of hinges are not shared.
        incidence: matrix from a configuration to the rows of all elements, kind by kind.
        transposed: its transpose.
    """

    counts: tuple[int, int, int]
    slots: tuple[int, int, int]
    incidence: sp.csr_array
    transposed: sp.csr_array

    def owned(self, place: int) -> list[slice]:
        """Slots of the fabric at a place of a pack, for each kind of elements."""
        starts = (place * slots for slots in self.slots)
        return [
            slice(start, start + count) for start, count in zip(starts, self.counts, strict=True)
        ]

    def chunks(self, fabrics: int) -> int:
        """Number of chunks that so many fabrics fill."""
        return max(
            -(-fabrics * slots // size) for slots, size in zip(self.slots, KINDS, strict=True)
        )


@cached_by_shape
def _mesh(shape: MeshShape) -> _Mesh:
    net = network(shape)
    counts = springs, hinges, nodes = len(net.springs.nodes), len(net.hinges.nodes), shape.nodes
    incidence = chunk_incidence(shape, counts, 1)
    slots = springs, -(-hinges // LANES) * LANES, nodes
    return _Mesh(counts, slots, incidence, incidence.T.tocsr())


class FabricPack:
    """Fabrics of one mesh shape, with one kind of fold angle and spring law.

    Not for several threads at a time: results are computed in memory that is reused.

    Args:
        shape: their mesh shape.
        fabrics: the fabrics.
    """

    def __init__(self, shape: MeshShape, fabrics: Sequence[Fabric]) -> None:
        self._mesh, self._fold_angle = _mesh(shape), fabrics[0].fold_angle
        self._fabrics = [jax.tree.map(np.asarray, fabric) for fabric in fabrics]
        chunks = self._mesh.chunks(len(fabrics))
        self._rows = [
            np.repeat(padding, chunks * size, axis=1)
            for padding, size in zip(PADDING, KINDS, strict=True)
        ]
        self._chunked: dict[tuple[tuple[int, float, float], ...], list[Parameters]] = {}

    def evaluate(self, points: Mapping[int, Point]) -> dict[int, Evaluation]:
        """Energy and gradient of some of the fabrics, in NumPy arrays.

        Args:
            points: stage and configuration of each, by its index in the pack.
        """
        computed = [
            _evaluate(self._fold_angle, *parameters, vectors)
            for parameters, vectors in self._chunks(points)
        ]
        energies = [_joined(parts) for parts in zip(*(parts for parts, _ in computed), strict=True)]
        gradient = [
            _joined(parts).reshape(rows, -1)
            for rows, parts in zip(ROWS, zip(*(by for _, by in computed), strict=True), strict=True)
        ]
        found: dict[int, Evaluation] = {}
        for place, fabric in enumerate(points):
            owned = self._mesh.owned(place)
            by_rows = np.concatenate(
                [part[:, own].ravel() for part, own in zip(gradient, owned, strict=True)]
            )
            totals = (part[own].sum() for part, own in zip(energies, owned, strict=True))
            found[fabric] = Evaluation(Energy(*totals), self._mesh.transposed @ by_rows)
        return found

    def element_hessians(self, points: Mapping[int, Point]) -> dict[int, ElementHessians]:
        """Element Hessians of some of the fabrics, in NumPy arrays; arguments as before."""
        computed = [
            chunk_hessians(self._fold_angle, *parameters, vectors)
            for parameters, vectors in self._chunks(points)
        ]
        springs, walls = (
            _joined([getattr(part, kind) for part in computed]) for kind in ("springs", "walls")
        )
        hinges = np.concatenate([np.asarray(part.hinges) for part in computed])
        blocks = self._mesh.slots[1] // LANES
        found: dict[int, ElementHessians] = {}
        for place, fabric in enumerate(points):
            of_springs, _, of_nodes = self._mesh.owned(place)
            of_hinges = slice(place * blocks, (place + 1) * blocks)
            found[fabric] = ElementHessians(
                springs[:, of_springs], hinges[of_hinges], walls[of_nodes]
            )
        return found

    def _chunks(self, points: Mapping[int, Point]) -> Iterator[tuple[Parameters, Any]]:
        """Parameters and vectors of the elements of some of the fabrics, chunk by chunk."""
        ends = np.cumsum(np.multiply(ROWS, self._mesh.counts))[:-1]
        for place, (_, unknowns) in enumerate(points.values()):
            rows = np.split(self._mesh.incidence @ unknowns, ends)
            for target, own, part in zip(self._rows, self._mesh.owned(place), rows, strict=True):
                target[:, own] = part.reshape(len(target), -1)
        for chunk, parameters in enumerate(self._parameters(points)):
            springs, hinges, heights = (
                part[:, chunk * size : (chunk + 1) * size]
                for part, size in zip(self._rows, KINDS, strict=True)
            )
            vectors = springs.reshape(1, 3, SPRINGS), hinges.reshape(5, 3, HINGES), heights[0]
            yield parameters, vectors

    def _parameters(self, points: Mapping[int, Point]) -> list[Parameters]:
        """Parameters of the elements of some of the fabrics at their stages, chunk by chunk."""
        key = tuple((k, float(at.fold), float(at.wall)) for k, (at, _) in points.items())
        if key not in self._chunked:
            self._chunked[key] = self._gathered(points)
        return self._chunked[key]

    def _gathered(self, points: Mapping[int, Point]) -> list[Parameters]:
        each = [self._of_fabric(fabric, stage) for fabric, (stage, _) in points.items()]
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *each)
        chunks = self._mesh.chunks(len(points))

        def filled(kind: int, values: np.ndarray) -> np.ndarray:
            size = KINDS[kind]
            return _padded(values, chunks * size).reshape(chunks, size, *values.shape[1:])

        parameters = tuple(
            jax.tree.map(partial(filled, kind), of_kind) for kind, of_kind in enumerate(whole)
        )
        (length, k_s, law), (rest, k_t), (z_max, k_wall) = parameters
        numbers = (z_max, k_wall), (length, k_s, rest, k_t, law)
        found = list[Parameters]()
        for chunk in range(chunks):
            walls, stiffnesses = jax.tree.map(
                lambda values, chunk=chunk: jax.device_put(values[chunk]), numbers
            )
            found.append(((1.0, *walls), stiffnesses))
        return found

    def _of_fabric(self, fabric: int, stage: Stage) -> Any:
        """Parameters of the slots of a fabric at a stage, as NumPy arrays."""
        own, nodes, hinges = self._fabrics[fabric], self._mesh.counts[2], self._mesh.slots[1]
        walls = np.full(nodes, own.z_max), np.full(nodes, float(stage.wall) * own.k_wall)
        rest = float(stage.fold) * own.rest_fold
        return (
            (own.rest_length, own.stretch_stiffness, own.spring_law),
            (_padded(rest, hinges), _padded(own.fold_stiffness, hinges, 0.0)),
            walls,
        )


def _padded(values: np.ndarray, length: int, by: float = 1.0) -> np.ndarray:
    """Values followed by a constant, for slots whose results are not used."""
    spare = [(0, length - len(values)), *[(0, 0)] * (values.ndim - 1)]
    return np.pad(values, spare, constant_values=by)


def _joined(parts: Sequence[Array]) -> np.ndarray:
    """The slots of all chunks."""
    return np.asarray(parts[0]) if len(parts) == 1 else np.concatenate(parts, axis=-1)


@partial(jax.jit, static_argnums=0)
def _evaluate(
    of: FoldAngle, acting: Any, stiffnesses: Stiffnesses, vectors: Vectors
) -> tuple[tuple[Array, Array, Array], Vectors]:
    """Energy of every element of a chunk, and their gradients with respect to the vectors."""

    def total(at: Vectors) -> tuple[Array, tuple[Array, Array, Array]]:
        parts = element_energies(of, acting, stiffnesses, at)
        return sum((part.sum() for part in parts), jnp.zeros(())), parts

    gradient, parts = jax.grad(total, has_aux=True)(vectors)
    return parts, gradient
