"""A fabric in portions: one compiled program a task, whatever the mesh shape.

XLA takes seconds to compile a network's energy and its derivatives, and would do so anew for every
mesh shape. But shapes differ only in which nodes an element joins, and that is a constant sparse
matrix: it takes a configuration to the vectors of all elements, and its transpose takes their
gradients back. What lies between depends on one element at a time. It is compiled for a chunk of a
fixed number of elements, of which a fabric has as many as it needs; the last is filled up with
elements of no stiffness.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from knitlab.linalg.threads import ALONE, Threads
from knitlab.mechanics.element_stiffness import (
    HINGE_ENTRIES,
    LANES,
    SPRING_ENTRIES,
    hinge_stiffness,
    spring_stiffness,
    wall_stiffness,
)
from knitlab.mechanics.evaluation import ElementHessians, Evaluation, Stage
from knitlab.model.energy import Energy, hinge_energy, spring_energy, wall_energy
from knitlab.model.fabric import Fabric
from knitlab.model.network import Elements, MeshShape, network
from knitlab.model.options import FoldAngle

HEIGHTS = 512
"""Nodes in a portion. It also holds the springs and hinges that so many nodes have in periodic
fabric, where they are most."""
SPRINGS, HINGES = 4 * HEIGHTS, 2 * HEIGHTS
VECTORS = 3 * SPRINGS + 15 * HINGES + HEIGHTS
"""Numbers that the energy of a portion depends on."""
WORTH_SHARING = 8
"""Portions from which on a second thread brings more than it costs."""

Places = Int[np.ndarray, " place"]
Vectors = tuple[Float[Array, "1 3 spring"], Float[Array, "5 3 hinge"], Float[Array, " node"]]
"""Of a portion: the vectors of its springs, those of its hinges, and the heights of its nodes
[mm]."""
Stiffnesses = tuple[
    Float[Array, " spring"], Float[Array, " spring"], Float[Array, " hinge"], Float[Array, " hinge"]
]
"""Of a portion: rest length and stiffness of its springs, rest angle and stiffness of its
hinges."""
Acting = Float[np.ndarray, "3"]
"""Fraction of the rest angles, z_max [mm] and stiffness of the walls [N/mm]."""


@dataclass(frozen=True, eq=False)
class ThreadChunks:
    """Portions that one thread works on.

    Attributes:
        first: the first of them.
        count: how many they are.
        incidence: constant matrix from configurations to their vectors.
        transposed: the same, from gradients by the vectors to those by the configuration.
    """

    first: int
    count: int
    incidence: sp.csr_array
    transposed: sp.csr_array

    @property
    def portions(self) -> range:
        """Which they are."""
        return range(self.first, self.first + self.count)

    def vectors(
        self, unknowns: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, "portion vector"]:
        """Their vectors in a configuration [mm]."""
        return (self.incidence @ unknowns).reshape(self.count, VECTORS)


@dataclass(frozen=True, eq=False)
class ElementChunks:
    """A mesh shape in portions.

    Attributes:
        shape: the mesh shape.
        count: number of portions.
        shares: the portions, in one part or, where they are many, in two.
    """

    shape: MeshShape
    count: int
    shares: tuple[ThreadChunks, ...]


@lru_cache(maxsize=16)
def portions(shape: MeshShape) -> ElementChunks:
    """Cut the network of a mesh shape into portions."""
    net = network(shape)
    count = -(-shape.nodes // HEIGHTS)
    nodes = np.arange(shape.nodes)
    of_nodes = _first_row(nodes, HEIGHTS, VECTORS - HEIGHTS), 3 * nodes + 2, np.ones(shape.nodes)
    terms = [
        *_terms(net.springs, count * SPRINGS, SPRINGS, 0),
        *_terms(net.hinges, count * HINGES, HINGES, 3 * SPRINGS),
        of_nodes,
    ]
    rows, columns, values = (np.concatenate(of) for of in zip(*terms, strict=True))
    incidence = sp.csr_array((values, (rows, columns)), shape=(count * VECTORS, shape.unknowns))
    incidence.eliminate_zeros()
    ends = [0, count] if count < WORTH_SHARING else [0, count // 2, count]
    return ElementChunks(shape, count, tuple(_share(incidence, *ends) for ends in pairwise(ends)))


def _share(incidence: sp.csr_array, first: int, end: int) -> ThreadChunks:
    own = incidence[first * VECTORS : end * VECTORS]
    return ThreadChunks(first, end - first, own, own.T.tocsr())


def _first_row(place: Places, per_portion: int, offset: int) -> Places:
    """Row of the first number of elements, by their place among those of their kind."""
    portion, lane = np.divmod(place, per_portion)
    return portion * VECTORS + offset + lane


def _terms(
    elements: Elements, places: int, per_portion: int, offset: int
) -> Iterator[tuple[Places, Places, Float[np.ndarray, " place"]]]:
    """Rows, columns and values of the incidence of one kind of elements."""
    place = np.arange(places)
    # Any element will do where there is none, as it has no stiffness there.
    which = np.minimum(place, len(elements.nodes) - 1)
    first, one = _first_row(place, per_portion, offset), np.ones(places)
    for vector, (start, end) in enumerate(elements.ends):
        for component in range(3):
            row = first + (3 * vector + component) * per_portion
            yield row, 3 * elements.nodes[which, end] + component, one
            yield row, 3 * elements.nodes[which, start] + component, -one
            if component < 2:
                length = np.full(places, elements.shape.unknowns - 2 + component)
                yield row, length, elements.periods[vector, component, which]


@dataclass(frozen=True, eq=False)
class ChunkedFabric:
    """A fabric laid out in portions, to be looked at in one configuration after the other.

    Attributes:
        portions: those of its mesh shape.
        stiffnesses: of each.
        walls: z_max [mm] and stiffness [N/mm].
        fold_angle: what its fold angles are between.
        threads: that look at it.
    """

    portions: ElementChunks
    stiffnesses: tuple[Stiffnesses, ...]
    walls: tuple[float, float]
    fold_angle: FoldAngle
    threads: Threads = ALONE

    @classmethod
    def of(cls, shape: MeshShape, fabric: Fabric, threads: Threads = ALONE) -> "ChunkedFabric":
        """Lay out a fabric, for some threads to look at."""
        its = portions(shape)
        numbers = [
            (fabric.rest_length, SPRINGS),
            (fabric.stretch_stiffness, SPRINGS),
            (fabric.rest_fold, HINGES),
            (fabric.fold_stiffness, HINGES),
        ]
        columns = []
        for number, per_portion in numbers:
            spare = its.count * per_portion - len(number)
            padded = np.pad(np.asarray(number), (0, spare)).reshape(its.count, per_portion)
            columns.append([jnp.asarray(row) for row in padded])
        walls = float(fabric.z_max), float(fabric.k_wall)
        numbered = tuple(zip(*columns, strict=True))
        return cls(its, numbered, walls, fabric.fold_angle, threads)

    def evaluate(self, stage: Stage, unknowns: Float[np.ndarray, " unknown"]) -> Evaluation:
        """What :func:`~knitlab.mechanics.evaluation.evaluate` gives, as NumPy arrays."""
        look = partial(self._evaluated, self._acting(stage), unknowns)
        energies, gradients = zip(*self.threads.each(look, self.portions.shares), strict=True)
        return Evaluation(Energy(*np.sum(energies, axis=0)), np.sum(gradients, axis=0))

    def _evaluated(
        self, acting: Acting, unknowns: Float[np.ndarray, " unknown"], share: ThreadChunks
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, " unknown"]]:
        """Energies of a share of the portions, and the gradient of their sum."""
        vectors = share.vectors(unknowns)
        energies, gradient = np.zeros(3), np.empty_like(vectors)
        for portion, here, by_here in zip(share.portions, vectors, gradient, strict=True):
            own = self.stiffnesses[portion]
            parts, by_vectors = _evaluate(self.fold_angle, acting, own, _split(here))
            energies += np.asarray(parts)
            for view, part in zip(_split(by_here), by_vectors, strict=True):
                view[:] = part
        return energies, share.transposed @ gradient.ravel()

    def element_hessians(
        self, stage: Stage, unknowns: Float[np.ndarray, " unknown"]
    ) -> ElementHessians:
        """What :func:`~knitlab.mechanics.evaluation.element_hessians` gives, as NumPy arrays."""
        count, net = self.portions.count, network(self.portions.shape)
        filled = ElementHessians(
            np.empty((len(SPRING_ENTRIES[0]), count * SPRINGS)),
            np.empty((count * HINGES // LANES, len(HINGE_ENTRIES[0]), LANES)),
            np.empty(count * HEIGHTS),
        )
        fill = partial(self._fill, filled, self._acting(stage), unknowns)
        self.threads.each(fill, self.portions.shares)
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
        share: ThreadChunks,
    ) -> None:
        """Fill in the element Hessians of a share of the portions."""
        for portion, here in zip(share.portions, share.vectors(unknowns), strict=True):
            own = self.stiffnesses[portion]
            part = _element_hessians(self.fold_angle, acting, own, _split(here))
            springs, hinges, heights = (
                slice(portion * each, (portion + 1) * each)
                for each in (SPRINGS, HINGES // LANES, HEIGHTS)
            )
            filled.springs[:, springs] = part.springs
            filled.hinges[hinges] = part.hinges
            filled.walls[heights] = part.walls

    def _acting(self, stage: Stage) -> Acting:
        z_max, k_wall = self.walls
        return np.array([float(stage.fold), z_max, float(stage.wall) * k_wall])


def _split(
    numbers: Float[np.ndarray, " vector"],
) -> tuple[
    Float[np.ndarray, "1 3 spring"], Float[np.ndarray, "5 3 hinge"], Float[np.ndarray, " node"]
]:
    """Views of the vectors of a portion's springs and hinges, and of its heights."""
    springs, hinges = numbers[: 3 * SPRINGS], numbers[3 * SPRINGS : -HEIGHTS]
    return springs.reshape(1, 3, SPRINGS), hinges.reshape(5, 3, HINGES), numbers[-HEIGHTS:]


def _elements(
    acting: Acting, stiffnesses: Stiffnesses, vectors: Vectors
) -> tuple[tuple[Array, Array, Array], ...]:
    """What the energies of a portion's springs, hinges and heights take."""
    length, k_s, rest, k_t = stiffnesses
    springs, hinges, heights = vectors
    fold, z_max, k_wall = acting
    return (springs, length, k_s), (hinges, fold * rest, k_t), (heights, z_max, k_wall)


@partial(jax.jit, static_argnums=0)
def _evaluate(
    of: FoldAngle, acting: Acting, stiffnesses: Stiffnesses, vectors: Vectors
) -> tuple[Float[Array, "3"], Vectors]:
    """Energies of a portion, and the gradient of their sum by the vectors."""

    def total(at: Vectors) -> tuple[Array, Array]:
        springs, hinges, heights = _elements(acting, stiffnesses, at)
        parts = spring_energy(*springs), hinge_energy(*hinges, of), wall_energy(*heights)
        energies = jnp.stack([part.sum() for part in parts])
        return energies.sum(), energies

    gradient, energies = jax.grad(total, has_aux=True)(vectors)
    return energies, gradient


@partial(jax.jit, static_argnums=0)
def _element_hessians(
    of: FoldAngle, acting: Acting, stiffnesses: Stiffnesses, vectors: Vectors
) -> ElementHessians:
    """Element Hessians of a portion."""
    (springs, *of_springs), hinges, heights = _elements(acting, stiffnesses, vectors)
    return ElementHessians(
        spring_stiffness(springs[0], *of_springs),
        hinge_stiffness(*hinges, of),
        wall_stiffness(*heights),
    )
