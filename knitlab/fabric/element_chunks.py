"""A fabric in chunks of elements: one compiled program for all mesh shapes.

XLA takes seconds to compile the energy of a network and its derivatives, and would do so for every
mesh shape. But mesh shapes differ only in the connectivity of the elements, which is a constant
sparse matrix: it maps a configuration to the vectors of all elements, and its transpose maps their
gradients back. The calculation in between treats every element separately. It is compiled for a
chunk of a fixed number of elements; a fabric consists of as many chunks as it needs, the last of
which is padded with elements without stiffness.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from knitlab.fabric.element_hessians import (
    HINGE_ENTRIES,
    LANES,
    SPRING_ENTRIES,
    ElementHessians,
    hinge_stiffness,
    spring_stiffness,
    wall_stiffness,
)
from knitlab.fabric.energy import (
    Energy,
    Evaluation,
    Stage,
    hinge_energy,
    spring_energy,
    wall_energy,
)
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import Elements, MeshShape, cached_by_shape, network
from knitlab.fabric.settings import FoldAngle
from knitlab.fabric.spring_law import SpringLaw
from knitlab.fabric.threads import ALONE, Threads

HEIGHTS = 512
"""Nodes in a chunk. It also holds the springs and hinges of that many nodes of periodic fabric,
which has the most of them."""
SPRINGS, HINGES = 4 * HEIGHTS, 2 * HEIGHTS
VECTORS = 3 * SPRINGS + 15 * HINGES + HEIGHTS
"""Parameters of the energy of a chunk."""
WORTH_SHARING = 8
"""Number of chunks from which a second thread pays off."""

Places = Int[np.ndarray, " place"]
Vectors = tuple[Float[Array, "1 3 spring"], Float[Array, "5 3 hinge"], Float[Array, " node"]]
"""Vectors of the springs of a chunk, vectors of its hinges, and heights of its nodes [mm]."""
Stiffnesses = tuple[
    Float[Array, " spring"],
    Float[Array, " spring"],
    Float[Array, " hinge"],
    Float[Array, " hinge"],
    SpringLaw,
]
"""Rest length and stiffness of the springs of a chunk, rest angle and stiffness of its hinges, and
the law of its springs."""
Acting = Float[np.ndarray, "3"]
"""Fraction of the rest angles, z_max [mm] and stiffness of the walls [N/mm]."""


@dataclass(frozen=True, eq=False)
class ThreadChunks:
    """Chunks that one thread works on.

    Attributes:
        first: index of the first chunk.
        count: number of chunks.
        incidence: constant matrix from configurations to the vectors of these chunks.
        transposed: its transpose, from gradients by the vectors to those by the configuration.
    """

    first: int
    count: int
    incidence: sp.csr_array
    transposed: sp.csr_array

    @property
    def chunks(self) -> range:
        """Indices of the chunks."""
        return range(self.first, self.first + self.count)

    def vectors(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "chunk vector"]:
        """Vectors of the chunks in a configuration [mm]."""
        return (self.incidence @ unknowns).reshape(self.count, VECTORS)


@dataclass(frozen=True, eq=False)
class ElementChunks:
    """A mesh shape in chunks.

    Attributes:
        shape: the mesh shape.
        count: number of chunks.
        by_thread: the chunks, for one thread or, if there are many, for two.
    """

    shape: MeshShape
    count: int
    by_thread: tuple[ThreadChunks, ...]


@cached_by_shape
def chunks_of(shape: MeshShape) -> ElementChunks:
    """The elements of the network of a mesh shape, in chunks."""
    count = -(-shape.nodes // HEIGHTS)
    incidence = chunk_incidence(shape, (SPRINGS, HINGES, HEIGHTS), count)
    ends = [0, count] if count < WORTH_SHARING else [0, count // 2, count]
    return ElementChunks(
        shape, count, tuple(_thread_chunks(incidence, *ends) for ends in pairwise(ends))
    )


def _thread_chunks(incidence: sp.csr_array, first: int, end: int) -> ThreadChunks:
    rows = incidence[first * VECTORS : end * VECTORS]
    return ThreadChunks(first, end - first, rows, rows.T.tocsr())


def chunk_incidence(shape: MeshShape, sizes: tuple[int, int, int], chunks: int) -> sp.csr_array:
    """Matrix from configurations to the vectors and heights of all chunks of a mesh shape.

    Args:
        shape: the mesh shape.
        sizes: numbers of springs, hinges and nodes in a chunk.
        chunks: number of chunks.
    """
    net, (springs, hinges, heights) = network(shape), sizes
    first_height = 3 * springs + 15 * hinges
    length, nodes = first_height + heights, np.arange(shape.nodes)
    chunk, lane = np.divmod(nodes, heights)
    terms = [
        *_terms(net.springs, chunks, springs, 0, length),
        *_terms(net.hinges, chunks, hinges, 3 * springs, length),
        (chunk * length + first_height + lane, 3 * nodes + 2, np.ones(shape.nodes)),
    ]
    rows, columns, values = (np.concatenate(parts) for parts in zip(*terms, strict=True))
    # SciPy would keep 64-bit indices, which take as much memory as the values.
    places = rows.astype(np.int32), columns.astype(np.int32)
    incidence = sp.csr_array((values, places), shape=(chunks * length, shape.unknowns))
    incidence.eliminate_zeros()
    return incidence


def _terms(
    elements: Elements, chunks: int, per_chunk: int, offset: int, length: int
) -> Iterator[tuple[Places, Places, Float[np.ndarray, " place"]]]:
    """Rows, columns and values of the incidence of one kind of elements."""
    places = chunks * per_chunk
    place = np.arange(places)
    # Padding may repeat any element, as it has no stiffness.
    element = np.minimum(place, len(elements.nodes) - 1)
    chunk, lane = np.divmod(place, per_chunk)
    first, ones = chunk * length + offset + lane, np.ones(places)
    for vector, (start, end) in enumerate(elements.ends):
        for component in range(3):
            row = first + (3 * vector + component) * per_chunk
            yield row, 3 * elements.nodes[element, end] + component, ones
            yield row, 3 * elements.nodes[element, start] + component, -ones
            if component < 2:
                period = np.full(places, elements.shape.unknowns - 2 + component)
                yield row, period, elements.periods[vector, component, element]


@dataclass(frozen=True, eq=False)
class ChunkedFabric:
    """A fabric in chunks, for repeated evaluation.

    Attributes:
        chunks: the chunks of its mesh shape.
        stiffnesses: rest values and stiffnesses of each chunk.
        walls: z_max [mm] and stiffness [N/mm].
        fold_angle: definition of the fold angle.
        threads: threads that evaluate it.
    """

    chunks: ElementChunks
    stiffnesses: tuple[Stiffnesses, ...]
    walls: tuple[float, float]
    fold_angle: FoldAngle
    threads: Threads = ALONE

    @classmethod
    def of(cls, shape: MeshShape, fabric: Fabric, threads: Threads = ALONE) -> "ChunkedFabric":
        """A fabric in chunks.

        Args:
            shape: mesh shape of the fabric.
            fabric: the fabric.
            threads: threads that share the work.
        """
        mesh_chunks = chunks_of(shape)
        count = mesh_chunks.count
        columns = [
            _in_chunks(fabric.rest_length, count, SPRINGS, spare=1.0),
            _in_chunks(fabric.stretch_stiffness, count, SPRINGS),
            _in_chunks(fabric.rest_fold, count, HINGES),
            _in_chunks(fabric.fold_stiffness, count, HINGES),
        ]
        parameters, structure = jax.tree.flatten(fabric.spring_law)
        of_law = [_in_chunks(parameter, count, SPRINGS) for parameter in parameters]
        laws = [
            jax.tree.unflatten(structure, [values[k] for values in of_law]) for k in range(count)
        ]
        walls = float(fabric.z_max), float(fabric.k_wall)
        numbered = tuple(zip(*columns, laws, strict=True))
        return cls(mesh_chunks, numbered, walls, fabric.fold_angle, threads)

    def evaluate(self, stage: Stage, unknowns: Float[np.ndarray, " unknown"]) -> Evaluation:
        """Like :func:`~knitlab.fabric.energy.evaluate`, in NumPy arrays."""
        evaluate_part = partial(self._evaluated, self._acting(stage), unknowns)
        energies, gradients = zip(
            *self.threads.each(evaluate_part, self.chunks.by_thread), strict=True
        )
        return Evaluation(Energy(*np.sum(energies, axis=0)), np.sum(gradients, axis=0))

    def _evaluated(
        self, acting: Acting, unknowns: Float[np.ndarray, " unknown"], thread_chunks: ThreadChunks
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, " unknown"]]:
        """Energies of the chunks of one thread, and the gradient of their sum."""
        vectors = thread_chunks.vectors(unknowns)
        energies, gradient = np.zeros(3), np.empty_like(vectors)
        for chunk, values, slopes in zip(thread_chunks.chunks, vectors, gradient, strict=True):
            stiffnesses = self.stiffnesses[chunk]
            parts, by_vectors = _evaluate(self.fold_angle, acting, stiffnesses, _split(values))
            energies += np.asarray(parts)
            for view, part in zip(_split(slopes), by_vectors, strict=True):
                view[:] = part
        return energies, thread_chunks.transposed @ gradient.ravel()

    def element_hessians(
        self, stage: Stage, unknowns: Float[np.ndarray, " unknown"]
    ) -> ElementHessians:
        """Like :func:`~knitlab.fabric.element_hessians.element_hessians`, in NumPy arrays."""
        count, net = self.chunks.count, network(self.chunks.shape)
        filled = ElementHessians(
            np.empty((len(SPRING_ENTRIES[0]), count * SPRINGS)),
            np.empty((count * HINGES // LANES, len(HINGE_ENTRIES[0]), LANES)),
            np.empty(count * HEIGHTS),
        )
        fill = partial(self._fill, filled, self._acting(stage), unknowns)
        self.threads.each(fill, self.chunks.by_thread)
        return ElementHessians(
            filled.springs[:, : len(net.springs.nodes)],
            filled.hinges[: -(-len(net.hinges.nodes) // LANES)],
            filled.walls[: net.shape.nodes],
        )

    def _fill(
        self,
        filled: ElementHessians,
        acting: Acting,
        unknowns: Float[np.ndarray, " unknown"],
        thread_chunks: ThreadChunks,
    ) -> None:
        """Compute the element Hessians of the chunks of one thread."""
        for chunk, values in zip(
            thread_chunks.chunks, thread_chunks.vectors(unknowns), strict=True
        ):
            stiffnesses = self.stiffnesses[chunk]
            part = chunk_hessians(self.fold_angle, acting, stiffnesses, _split(values))
            springs, hinges, heights = (
                slice(chunk * per_chunk, (chunk + 1) * per_chunk)
                for per_chunk in (SPRINGS, HINGES // LANES, HEIGHTS)
            )
            filled.springs[:, springs] = part.springs
            filled.hinges[hinges] = part.hinges
            filled.walls[heights] = part.walls

    def _acting(self, stage: Stage) -> Acting:
        z_max, k_wall = self.walls
        return np.array([float(stage.fold), z_max, float(stage.wall) * k_wall])


def _in_chunks(
    number: Float[Array | np.ndarray, " element ..."],
    count: int,
    per_chunk: int,
    spare: float = 0.0,
) -> list[Float[Array, " place ..."]]:
    """A parameter of all elements by chunks; the last chunk is padded."""
    none = [(0, count * per_chunk - len(number)), *[(0, 0)] * (number.ndim - 1)]
    padded = np.pad(np.asarray(number), none, constant_values=spare)
    # On the processor also where JAX finds an accelerator: all else of a search is done there.
    rows = padded.reshape(count, per_chunk, *number.shape[1:])
    return [jax.device_put(row, jax.local_devices(backend="cpu")[0]) for row in rows]


def _split(
    numbers: Float[np.ndarray, " vector"],
) -> tuple[
    Float[np.ndarray, "1 3 spring"], Float[np.ndarray, "5 3 hinge"], Float[np.ndarray, " node"]
]:
    """Views of the vectors of a chunk's springs and hinges, and of its heights."""
    springs, hinges = numbers[: 3 * SPRINGS], numbers[3 * SPRINGS : -HEIGHTS]
    return springs.reshape(1, 3, SPRINGS), hinges.reshape(5, 3, HINGES), numbers[-HEIGHTS:]


def _elements(
    acting: Any, stiffnesses: Stiffnesses, vectors: Vectors
) -> tuple[
    tuple[Array, Array, Array, SpringLaw], tuple[Array, Array, Array], tuple[Array, Array, Array]
]:
    """Arguments of the energies of a chunk's springs, hinges and heights."""
    length, k_s, rest, k_t, law = stiffnesses
    springs, hinges, heights = vectors
    fold, z_max, k_wall = acting
    return (springs, length, k_s, law), (hinges, fold * rest, k_t), (heights, z_max, k_wall)


def element_energies(
    of: FoldAngle, acting: Any, stiffnesses: Stiffnesses, vectors: Vectors
) -> tuple[Array, Array, Array]:
    """Energies of each spring, hinge and node of a chunk.

    ``acting`` has z_max and the stiffness of the walls for all nodes, or for each.
    """
    springs, hinges, heights = _elements(acting, stiffnesses, vectors)
    return spring_energy(*springs), hinge_energy(*hinges, of), wall_energy(*heights)


@partial(jax.jit, static_argnums=0)
def _evaluate(
    of: FoldAngle, acting: Acting, stiffnesses: Stiffnesses, vectors: Vectors
) -> tuple[Float[Array, "3"], Vectors]:
    """Energies of a chunk, and the gradient of their sum with respect to the vectors."""

    def total(at: Vectors) -> tuple[Array, Array]:
        parts = element_energies(of, acting, stiffnesses, at)
        energies = jnp.stack([part.sum() for part in parts])
        return energies.sum(), energies

    gradient, energies = jax.grad(total, has_aux=True)(vectors)
    return energies, gradient


@partial(jax.jit, static_argnums=0)
def chunk_hessians(
    of: FoldAngle, acting: Any, stiffnesses: Stiffnesses, vectors: Vectors
) -> ElementHessians:
    """Element Hessians of a chunk; arguments as for :func:`element_energies`."""
    (springs, length, k_s, law), hinges, heights = _elements(acting, stiffnesses, vectors)
    return ElementHessians(
        spring_stiffness(springs[0], length, k_s, law),
        hinge_stiffness(*hinges, of),
        wall_stiffness(*heights),
    )
