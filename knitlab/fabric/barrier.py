"""The barrier: a potential that grows without bound as parts come as near as they may.

Energy, gradient, Hessian and collision-free steps are those of the IPC Toolkit (Li et al.,
Incremental Potential Contact, ACM Trans. Graph. 39, 2020): a sum over pairs of a node and a
triangle, and of two edges. Each pair stands for a part of the sheet, so that the sum is multiplied
by the area of a grid cell.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.fabric.contact_mesh import ContactMesh, contact_mesh
from knitlab.fabric.energy import Evaluation
from knitlab.fabric.network import MeshShape
from knitlab.fabric.pair_search import PairSearch
from knitlab.fabric.pattern import CELLS_PER_PERIOD
from knitlab.fabric.settings import CONTACT_RANGE

# Workers have one thread each; the library would take all cores in every one of them.
ipctk.set_num_threads(1)

NEAR_RANGE = 0.1
"""Distance over which the barrier acts between parts that are near on the grid, in thicknesses: it
keeps them from passing through each other, and leaves the calibrated folds alone."""
KEPT_PART = 0.5
"""Part of the collision-free step that is taken, so that the barrier is finite after it."""
LEAST_FREE = 1e-12
"""Distance over the least allowed one, less 1, below which a configuration counts as touching."""

Unknowns = Float[np.ndarray, " unknown"]


Touching = tuple[ipctk.NormalCollisions, ipctk.CollisionMesh, Float[np.ndarray, "part 3"]]
"""Pairs within reach of the barrier, their collision mesh, and the positions of its vertices."""


class Barrier:
    """Contact of one fabric with itself, without friction.

    Args:
        shape: mesh shape of the fabric.
        thickness: distance of the middle surfaces of two touching plies [mm].
        pressure: pressure scale of the barrier [N/mm²].
        cell: mean sides (x, y) of a grid cell [mm].
        cells_per_period: grid cells along one period of a stripe.
    """

    def __init__(
        self,
        shape: MeshShape,
        thickness: float,
        pressure: float,
        cell: tuple[float, float],
        cells_per_period: int = CELLS_PER_PERIOD,
    ) -> None:
        self._shape, self._thickness, self._cells_per_period = shape, thickness, cells_per_period
        self._force, self._cell = pressure * cell[0] * cell[1], min(cell)
        self._use(cells_per_period)

    def _use(self, band: int) -> None:
        self._mesh = contact_mesh(self._shape, band, self._cells_per_period)
        thickness = self._thickness
        self._searches = [
            PairSearch(self._mesh, near, least, reach, self._cell)
            for near, least, reach in (
                (False, thickness, CONTACT_RANGE * thickness),
                (True, 0.0, NEAR_RANGE * thickness),
            )
        ]

    def _vertices(self, *configurations: Unknowns) -> list[Float[np.ndarray, "vertex 3"]]:
        """Vertices of the contact mesh, with a band of images that is wide enough for all."""
        reach = (1 + CONTACT_RANGE) * self._thickness
        while not all(self._mesh.suffices(unknowns, reach) for unknowns in configurations):
            self._use(2 * self._mesh.band)
        return [self._mesh.vertices(unknowns) for unknowns in configurations]

    def added(self, evaluation: Evaluation, unknowns: Unknowns) -> Evaluation:
        """The evaluation of a configuration that holds, with energy and gradient of the barrier."""
        energy, gradient = 0.0, np.zeros(len(unknowns))
        for search, mesh, touching in self._touching(unknowns):
            potential = self._potential(search)
            energy += potential(*touching)
            gradient += mesh.from_unknowns.T @ potential.gradient(*touching)
        if not energy:
            return evaluation
        total: Any = np.asarray(evaluation.gradient) + gradient
        return Evaluation(replace(evaluation.energy, contact=energy), total)

    def hessian(self, unknowns: Unknowns, free: Int[np.ndarray, " free"]) -> sp.csc_array | None:
        """Hessian of the barrier by the free unknowns, made positive semidefinite pair by pair.

        Returns:
            (free, free), both triangles [N/mm]; ``None`` where nothing is within reach.
        """
        terms = []
        for search, mesh, touching in self._touching(unknowns):
            potential, of_free = self._potential(search), mesh.from_unknowns[:, free]
            by_vertex = potential.hessian(*touching, ipctk.PSDProjectionMethod.CLAMP)
            terms.append(of_free.T @ sp.csr_array(by_vertex) @ of_free)
        return sp.csc_array(sum(terms[1:], terms[0])) if terms else None

    def free_part(self, unknowns: Unknowns, step: Unknowns) -> float:
        """Part of a step, at most 1, after which all parts still keep their distance."""
        before, after = self._vertices(unknowns, unknowns + step)
        part = min(search.free_part(before, after) for search in self._searches)
        return part if part == 1 else KEPT_PART * part

    def holds(self, unknowns: Unknowns) -> bool:
        """Whether all parts keep their distance, and nothing passes through anything."""
        for search, _, (collisions, parts, positions) in self._touching(unknowns):
            squared = collisions.compute_minimum_distance(parts, positions)
            if squared <= search.least**2 * (1 + LEAST_FREE):
                return False
        (vertices,) = self._vertices(unknowns)
        return not ipctk.has_intersections(self._mesh.whole, vertices)

    def _touching(self, unknowns: Unknowns) -> Iterator[tuple[PairSearch, ContactMesh, Touching]]:
        """What is within reach of the barrier, by search, with the mesh that it belongs to."""
        (vertices,) = self._vertices(unknowns)
        for search in self._searches:
            pairs, collisions = search.close(vertices), ipctk.NormalCollisions()
            if not len(pairs.candidates):
                continue
            positions = pairs.positions(vertices)
            reach, least = search.reach, search.least
            collisions.build(pairs.candidates, pairs.parts, positions, reach, least)
            if len(collisions):
                yield search, pairs.mesh, (collisions, pairs.parts, positions)

    def _potential(self, search: PairSearch) -> ipctk.BarrierPotential:
        # The library's barrier takes squared distances, so that its value is a length to the 4th.
        squared = 2 * search.least * search.reach + search.reach**2
        return ipctk.BarrierPotential(search.reach, self._force * search.reach / squared**2, False)
