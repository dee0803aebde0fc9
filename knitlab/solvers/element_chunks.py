"""A fabric in chunks of elements: one compiled program for all mesh shapes.

XLA takes seconds to compile the energy of a network. Mesh shapes differ only in the connectivity of
the elements, a constant sparse matrix that maps a configuration to the vectors of all elements; its
transpose maps their gradients back. What lies between is compiled for a chunk of a fixed number of
elements; the last chunk of a fabric is padded with elements without stiffness.
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

from knitlab.model import energy
from knitlab.model.fabric import Fabric, Unknowns
from knitlab.model.fold_friction import FoldFriction
from knitlab.model.network import LENGTHS, Elements, MeshShape, cached_by_shape, network
from knitlab.model.settings import FoldAngle
from knitlab.model.spring_law import SpringLaw
from knitlab.model.threads import ALONE, Threads

HEIGHTS = 512
"""Nodes in a chunk. It also holds the springs and hinges of that many nodes of periodic fabric,
which has the most of them."""
SPRINGS = 4 * HEIGHTS
HINGES = 2 * HEIGHTS
VECTORS = 3 * SPRINGS + 15 * HINGES + HEIGHTS  # parameters of the energy of a chunk
WORTH_SHARING = 8  # number of chunks from which a second thread pays off

Indices = Int[np.ndarray, " entry"]
Vectors = tuple[Float[Array, "1 3 spring"], Float[Array, "5 3 hinge"], Float[Array, " node"]]
"""Vectors of the springs of a chunk, vectors of its hinges, and heights of its nodes [mm]."""
Acting = Float[np.ndarray, "3"]  # fraction of rest angles, z_max [mm], wall stiffness [N/mm]
Parameters = tuple[
    tuple[Float[Array, " spring"], Float[Array, " spring"], SpringLaw],
    tuple[Float[Array, " hinge"], Float[Array, " hinge"], FoldFriction | None],
]
"""Rest lengths, stiffnesses and law of the springs of a chunk; rest angles, stiffnesses and
friction of its hinges."""


@dataclass(frozen=True, eq=False)
class ThreadChunks:
    """Chunks that one thread works on, and the matrix from configurations to their vectors."""

    chunks: range
    incidence: sp.csr_array
    transposed: sp.csr_array

    def vectors(self, unknowns: Unknowns) -> Float[np.ndarray, "chunk vector"]:
        """Vectors of the chunks in a configuration [mm]."""
        return (self.incidence @ unknowns).reshape(len(self.chunks), VECTORS)


@cached_by_shape
def thread_chunks(shape: MeshShape) -> tuple[ThreadChunks, ...]:
    """The network of a mesh shape in chunks: for one thread or, if there are many, for two."""
    net = network(shape)
    count = -(-shape.nodes // HEIGHTS)
    nodes = np.arange(shape.nodes)
    chunk, lane = np.divmod(nodes, HEIGHTS)
    height = chunk * VECTORS + VECTORS - HEIGHTS + lane
    terms = [
        *_terms(net.springs, count, SPRINGS, 0),
        *_terms(net.hinges, count, HINGES, 3 * SPRINGS),
        (height, 3 * nodes + 2, np.ones(shape.nodes)),
    ]
    rows, columns, values = (np.concatenate(parts) for parts in zip(*terms, strict=True))
    # SciPy would keep 64-bit indices, which take as much memory as the values.
    indices = rows.astype(np.int32), columns.astype(np.int32)
    incidence = sp.csr_array((values, indices), shape=(count * VECTORS, shape.unknowns))
    incidence.eliminate_zeros()
    ends = [0, count] if count < WORTH_SHARING else [0, count // 2, count]
    parts = [
        (range(*own), incidence[own[0] * VECTORS : own[1] * VECTORS]) for own in pairwise(ends)
    ]
    return tuple(ThreadChunks(chunks, own, own.T.tocsr()) for chunks, own in parts)


def _terms(
    elements: Elements, chunks: int, per_chunk: int, offset: int
) -> Iterator[tuple[Indices, Indices, Float[np.ndarray, " entry"]]]:
    slot = np.arange(chunks * per_chunk)
    # Padding may repeat any element, as it has no stiffness.
    element = np.minimum(slot, len(elements.nodes) - 1)
    chunk, lane = np.divmod(slot, per_chunk)
    first = chunk * VECTORS + offset + lane
    ones = np.ones(len(slot))
    for vector, (start, end) in enumerate(elements.ends):
        for component in range(3):
            row = first + (3 * vector + component) * per_chunk
            yield row, 3 * elements.nodes[element, end] + component, ones
            yield row, 3 * elements.nodes[element, start] + component, -ones
            shape = elements.shape
            of_lengths = elements.periods[vector, :, element]
            for number, moved, along in LENGTHS[: shape.lengths]:
                if component == moved:
                    of_length = np.full(len(slot), 3 * shape.nodes + number)
                    yield row, of_length, of_lengths[:, along]


class ChunkedFabric:
    """A fabric in chunks, for repeated evaluation in NumPy arrays; threads share the work."""

    def __init__(self, shape: MeshShape, fabric: Fabric, threads: Threads = ALONE) -> None:
        self.shape = shape
        self._by_thread = thread_chunks(shape)
        self._threads = threads
        self._fold_angle = fabric.fold_angle
        self._walls = float(fabric.z_max), float(fabric.k_wall)
        count = self._by_thread[-1].chunks.stop
        lengths = _in_chunks(fabric.rest_length, count, SPRINGS, spare=1.0)
        springs = _in_chunks((fabric.stretch_stiffness, fabric.spring_law), count, SPRINGS)
        of_hinges = fabric.rest_fold, fabric.fold_stiffness, fabric.friction
        hinges = _in_chunks(of_hinges, count, HINGES)
        self._parameters: list[Parameters] = [
            ((length, *spring), hinge)
            for length, spring, hinge in zip(lengths, springs, hinges, strict=True)
        ]

    def evaluate(self, stage: energy.Stage, unknowns: Unknowns) -> energy.Evaluation:
        """Energy and gradient of a configuration at a stage."""
        acting = self._acting(stage)

        def evaluate_chunks(own_chunks: ThreadChunks) -> tuple[Float[np.ndarray, "3"], Unknowns]:
            vectors = own_chunks.vectors(unknowns)
            energies = np.zeros(3)
            gradient = np.empty_like(vectors)
            for chunk, values, slopes in zip(own_chunks.chunks, vectors, gradient, strict=True):
                of_chunk = self._parameters[chunk]
                own, by_vectors = _evaluate(self._fold_angle, acting, of_chunk, _split(values))
                energies += np.asarray(own)
                for view, by_kind in zip(_split(slopes), by_vectors, strict=True):
                    view[:] = by_kind
            return energies, own_chunks.transposed @ gradient.ravel()

        energies, gradients = zip(
            *self._threads.each(evaluate_chunks, self._by_thread), strict=True
        )
        return energy.Evaluation(
            energy.Energy(*np.sum(energies, axis=0)), np.sum(gradients, axis=0)
        )

    def element_hessians(self, stage: energy.Stage, unknowns: Unknowns) -> energy.ElementHessians:
        """Element Hessians of a configuration at a stage."""
        count = len(self._parameters)
        net = network(self.shape)
        acting = self._acting(stage)
        filled = energy.ElementHessians(
            np.empty((len(energy.SPRING_ENTRIES[0]), count * SPRINGS)),
            np.empty((count * HINGES // energy.LANES, len(energy.HINGE_ENTRIES[0]), energy.LANES)),
            np.empty(count * HEIGHTS),
        )

        def fill(own_chunks: ThreadChunks) -> None:
            for chunk, values in zip(own_chunks.chunks, own_chunks.vectors(unknowns), strict=True):
                own = _hessians(self._fold_angle, acting, self._parameters[chunk], _split(values))
                springs, hinges, heights = (
                    slice(chunk * per_chunk, (chunk + 1) * per_chunk)
                    for per_chunk in (SPRINGS, HINGES // energy.LANES, HEIGHTS)
                )
                filled.springs[:, springs] = own.springs
                filled.hinges[hinges] = own.hinges
                filled.walls[heights] = own.walls

        self._threads.each(fill, self._by_thread)
        return energy.ElementHessians(
            filled.springs[:, : len(net.springs.nodes)],
            filled.hinges[: -(-len(net.hinges.nodes) // energy.LANES)],
            filled.walls[: net.shape.nodes],
        )

    def _acting(self, stage: energy.Stage) -> Acting:
        z_max, k_wall = self._walls
        return np.array([float(stage.fold), z_max, float(stage.wall) * k_wall])


def _in_chunks(parameters: Any, count: int, per_chunk: int, spare: float = 0.0) -> list[Any]:
    """A pytree of parameters of all elements by chunks; the last chunk is padded."""
    # On the processor also where JAX finds an accelerator: all else of a search is done there.
    processor = jax.local_devices(backend="cpu")[0]

    def rows(values: Float[Array | np.ndarray, " element ..."]) -> Float[np.ndarray, "chunk ..."]:
        none = [(0, count * per_chunk - len(values)), *[(0, 0)] * (values.ndim - 1)]
        padded = np.pad(np.asarray(values), none, constant_values=spare)
        return padded.reshape(count, per_chunk, *values.shape[1:])

    leaves, structure = jax.tree.flatten(parameters)
    chunks = zip(*map(rows, leaves), strict=True)
    return [jax.device_put(jax.tree.unflatten(structure, own), processor) for own in chunks]


def _split(
    numbers: Float[np.ndarray, " vector"],
) -> tuple[
    Float[np.ndarray, "1 3 spring"], Float[np.ndarray, "5 3 hinge"], Float[np.ndarray, " node"]
]:
    springs = numbers[: 3 * SPRINGS]
    hinges = numbers[3 * SPRINGS : -HEIGHTS]
    return springs.reshape(1, 3, SPRINGS), hinges.reshape(5, 3, HINGES), numbers[-HEIGHTS:]


@partial(jax.jit, static_argnums=0)
def _evaluate(
    of: FoldAngle, acting: Acting, parameters: Parameters, vectors: Vectors
) -> tuple[Float[Array, "3"], Vectors]:
    springs, (rest, k_t, friction) = parameters
    fold, z_max, k_wall = acting

    def total(at: Vectors) -> tuple[Array, Array]:
        stretch = energy.spring_energy(at[0], *springs).sum()
        folded = energy.hinge_energy(at[1], fold * rest, k_t, of, friction).sum()
        energies = jnp.stack([stretch, folded, energy.wall_energy(at[2], z_max, k_wall).sum()])
        return energies.sum(), energies

    gradient, energies = jax.grad(total, has_aux=True)(vectors)
    return energies, gradient


@partial(jax.jit, static_argnums=0)
def _hessians(
    of: FoldAngle, acting: Acting, parameters: Parameters, vectors: Vectors
) -> energy.ElementHessians:
    springs, (rest, k_t, friction) = parameters
    fold, z_max, k_wall = acting
    return energy.ElementHessians(
        energy.spring_stiffness(vectors[0][0], *springs),
        energy.hinge_stiffness(vectors[1], fold * rest, k_t, of, friction),
        energy.wall_stiffness(vectors[2], z_max, k_wall),
    )
