"""The barrier: a potential that grows without bound as parts come as near as they may.

Energy, gradient, Hessian and collision-free steps are those of the IPC Toolkit (Li et al.,
Incremental Potential Contact, ACM Trans. Graph. 39, 2020): a sum over pairs of a node and a
triangle, and of two edges. Each pair stands for a part of the sheet, so that the sum is multiplied
by the area of a grid cell.
"""

from dataclasses import replace
from typing import Any

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.contact.contact_mesh import ContactMesh, contact_mesh, without_pairs_of_images
from knitlab.contact.distances import NEAR_RANGE, RANGE
from knitlab.elasticity.evaluation import Evaluation
from knitlab.model.network import MeshShape
from knitlab.model.pattern import CELLS_PER_PERIOD

# Workers have one thread each; the library would take all cores in every one of them.
ipctk.set_num_threads(1)

KEPT_PART = 0.5
"""Part of the collision-free step that is taken, so that the barrier is finite after it."""
LEAST_FREE = 1e-12
"""Distance over the least allowed one, less 1, below which a configuration counts as touching."""


MARGIN = 0.3
"""Distance that vertices may move before pairs are searched anew, over the shortest cell side."""


class _Layer:
    """Parts that keep one distance.

    Pairs of parts that may come within reach are searched with a margin, and searched anew only
    when a vertex has moved further than that.

    Args:
        whole: the contact mesh.
        mesh: the collision mesh of these parts.
        least: distance that they keep [mm].
        reach: distance beyond it over which the barrier acts [mm].
        margin: distance that vertices may move before pairs are searched anew [mm].
    """

    def __init__(
        self,
        whole: ContactMesh,
        mesh: ipctk.CollisionMesh,
        least: float,
        reach: float,
        margin: float,
    ) -> None:
        self._whole = whole
        self.mesh, self.least, self.reach, self._margin = mesh, least, reach, margin
        self._searched_at = np.full((mesh.num_vertices, 3), np.inf)
        self._candidates = ipctk.Candidates()
        self._once = False

    def _within_margin(self, vertices: np.ndarray) -> bool:
        moved = vertices - self._searched_at
        return bool(np.einsum("vc,vc->v", moved, moved).max() <= self._margin**2)

    def _search(self, vertices: np.ndarray) -> None:
        if not self._within_margin(vertices):
            radius = (self.least + self.reach) / 2 + self._margin
            self._candidates.build(self.mesh, vertices, radius)
            self._searched_at, self._once = vertices, False

    def collisions(self, vertices: np.ndarray) -> ipctk.NormalCollisions:
        """Pairs within reach of the barrier, each once."""
        self._search(vertices)
        found = ipctk.NormalCollisions()
        found.build(self._candidates, self.mesh, vertices, self.reach, self.least)
        if len(found) and not self._once:
            # Only now, as this takes longer than the search, and most searches find no pair.
            without_pairs_of_images(self._candidates, self._whole)
            self._once = True
            found.build(self._candidates, self.mesh, vertices, self.reach, self.least)
        return found

    def potential(self, force: float) -> ipctk.BarrierPotential:
        """The barrier potential of pairs that repel each other with a force of this scale [N]."""
        # The library's barrier takes squared distances, so that its value is a length to the 4th.
        squared = 2 * self.least * self.reach + self.reach**2
        return ipctk.BarrierPotential(self.reach, force * self.reach / squared**2, False)

    def free_part(self, before: np.ndarray, after: np.ndarray) -> float:
        """Part of a straight step that brings no parts as near as they may be."""
        self._search(before)
        candidates = self._candidates
        if not self._within_margin(after):
            candidates = ipctk.Candidates()
            candidates.build(self.mesh, before, after, (self.least + self.reach) / 2)
        if not len(candidates):
            return 1.0
        return candidates.compute_collision_free_stepsize(
            self.mesh, before, after, self.least, ipctk.AdditiveCCD()
        )


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
        self._force, self._margin = pressure * cell[0] * cell[1], MARGIN * min(cell)
        self._use(cells_per_period)

    def _use(self, band: int) -> None:
        self._mesh = mesh = contact_mesh(self._shape, band, self._cells_per_period)
        thickness, margin = self._thickness, self._margin
        self._layers = (
            _Layer(mesh, mesh.far, thickness, RANGE * thickness, margin),
            _Layer(mesh, mesh.near, 0.0, NEAR_RANGE * thickness, margin),
        )

    def _vertices(
        self, *configurations: Float[np.ndarray, " unknown"]
    ) -> list[Float[np.ndarray, "vertex 3"]]:
        """Vertices of the contact mesh, with a band of images that is wide enough for all."""
        reach = (1 + RANGE) * self._thickness
        while not all(self._mesh.suffices(unknowns, reach) for unknowns in configurations):
            self._use(2 * self._mesh.band)
        return [self._mesh.vertices(unknowns) for unknowns in configurations]

    def added(self, evaluation: Evaluation, unknowns: Float[np.ndarray, " unknown"]) -> Evaluation:
        """The evaluation of a configuration that holds, with energy and gradient of the barrier."""
        (vertices,) = self._vertices(unknowns)
        energy, gradient = 0.0, np.zeros(vertices.size)
        for layer in self._layers:
            collisions = layer.collisions(vertices)
            if len(collisions):
                potential = layer.potential(self._force)
                energy += potential(collisions, layer.mesh, vertices)
                gradient += potential.gradient(collisions, layer.mesh, vertices)
        if not energy:
            return evaluation
        total: Any = np.asarray(evaluation.gradient) + self._mesh.from_unknowns.T @ gradient
        return Evaluation(replace(evaluation.energy, contact=energy), total)

    def hessian(
        self, unknowns: Float[np.ndarray, " unknown"], free: Int[np.ndarray, " free"]
    ) -> sp.csc_array | None:
        """Hessian of the barrier by the free unknowns, made positive semidefinite pair by pair.

        Returns:
            (free, free), both triangles [N/mm]; ``None`` where nothing is within reach.
        """
        (vertices,) = self._vertices(unknowns)
        found = None
        for layer in self._layers:
            collisions = layer.collisions(vertices)
            if not len(collisions):
                continue
            part = layer.potential(self._force).hessian(
                collisions, layer.mesh, vertices, ipctk.PSDProjectionMethod.CLAMP
            )
            found = part if found is None else found + part
        if found is None:
            return None
        of_free = self._mesh.from_unknowns[:, free]
        return sp.csc_array(of_free.T @ sp.csr_array(found) @ of_free)

    def free_part(
        self, unknowns: Float[np.ndarray, " unknown"], step: Float[np.ndarray, " unknown"]
    ) -> float:
        """Part of a step, at most 1, after which all parts still keep their distance."""
        before, after = self._vertices(unknowns, unknowns + step)
        part = min(layer.free_part(before, after) for layer in self._layers)
        return part if part == 1 else KEPT_PART * part

    def holds(self, unknowns: Float[np.ndarray, " unknown"]) -> bool:
        """Whether all parts keep their distance, and nothing passes through anything."""
        (vertices,) = self._vertices(unknowns)
        for layer in self._layers:
            collisions = layer.collisions(vertices)
            if len(collisions):
                squared = collisions.compute_minimum_distance(layer.mesh, vertices)
                if squared <= layer.least**2 * (1 + LEAST_FREE):
                    return False
        return not ipctk.has_intersections(self._mesh.whole, vertices)
