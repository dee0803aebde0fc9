"""The barrier: a potential that grows without bound as parts come as near as they may.

Energy, gradient, Hessian and collision-free steps are those of the IPC Toolkit (Li et al.,
Incremental Potential Contact, ACM Trans. Graph. 39, 2020), weighted by area so that they hardly
depend on the mesh (Li et al., Convergent Incremental Potential Contact, 2023).
"""

from dataclasses import replace
from typing import Any

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.contact.contact_mesh import ContactMesh
from knitlab.elasticity.evaluation import Evaluation

RANGE = 0.25
"""Distance over which the barrier acts, in thicknesses."""
NEAR_RANGE = 0.1
"""Distance over which it acts between parts that are near on the grid, in thicknesses: it keeps
them from passing through each other, and leaves the calibrated folds alone."""
KEPT_PART = 0.8
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
        mesh: their collision mesh.
        least: distance that they keep [mm].
        reach: distance beyond it over which the barrier acts [mm].
        margin: distance that vertices may move before pairs are searched anew [mm].
    """

    def __init__(
        self, mesh: ipctk.CollisionMesh, least: float, reach: float, margin: float
    ) -> None:
        self.mesh, self.least, self.reach, self._margin = mesh, least, reach, margin
        self._searched_at = np.full((mesh.num_vertices, 3), np.inf)
        self._candidates = ipctk.Candidates()

    def _within_margin(self, vertices: np.ndarray) -> bool:
        moved = vertices - self._searched_at
        return bool(np.einsum("vc,vc->v", moved, moved).max() <= self._margin**2)

    def _search(self, vertices: np.ndarray) -> None:
        if not self._within_margin(vertices):
            radius = (self.least + self.reach) / 2 + self._margin
            self._candidates.build(self.mesh, vertices, radius)
            self._searched_at = vertices

    def collisions(self, vertices: np.ndarray) -> ipctk.NormalCollisions:
        """Pairs within reach of the barrier."""
        self._search(vertices)
        found = ipctk.NormalCollisions()
        found.use_area_weighting = True
        found.collision_set_type = ipctk.NormalCollisions.IMPROVED_MAX_APPROX
        found.build(self._candidates, self.mesh, vertices, self.reach, self.least)
        return found

    def potential(self, stiffness: float) -> ipctk.BarrierPotential:
        """The barrier potential; scaled so that its unit is that of ``stiffness`` times length."""
        # The library's barrier takes squared distances, so that its value is a length to the 4th.
        squared = 2 * self.least * self.reach + self.reach**2
        return ipctk.BarrierPotential(self.reach, stiffness * self.reach / squared**2, False)

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
        mesh: the contact mesh.
        thickness: distance of the middle surfaces of two touching plies [mm].
        stiffness: pressure scale of the barrier [N/mm²].
        cell: shortest side of a grid cell [mm].
    """

    def __init__(self, mesh: ContactMesh, thickness: float, stiffness: float, cell: float) -> None:
        self._mesh, self._stiffness = mesh, stiffness
        margin = MARGIN * cell
        self._layers = (
            _Layer(mesh.far, thickness, RANGE * thickness, margin),
            _Layer(mesh.near, 0.0, NEAR_RANGE * thickness, margin),
        )

    def added(self, evaluation: Evaluation, unknowns: Float[np.ndarray, " unknown"]) -> Evaluation:
        """The evaluation of a configuration that holds, with energy and gradient of the barrier."""
        vertices = self._mesh.vertices(unknowns)
        energy, gradient = 0.0, np.zeros(vertices.size)
        for layer in self._layers:
            collisions = layer.collisions(vertices)
            if len(collisions):
                potential = layer.potential(self._stiffness)
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
        vertices = self._mesh.vertices(unknowns)
        found = None
        for layer in self._layers:
            collisions = layer.collisions(vertices)
            if not len(collisions):
                continue
            part = layer.potential(self._stiffness).hessian(
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
        before, after = self._mesh.vertices(unknowns), self._mesh.vertices(unknowns + step)
        part = min(layer.free_part(before, after) for layer in self._layers)
        return part if part == 1 else KEPT_PART * part

    def holds(self, unknowns: Float[np.ndarray, " unknown"]) -> bool:
        """Whether all parts keep their distance, and nothing passes through anything."""
        vertices = self._mesh.vertices(unknowns)
        for layer in self._layers:
            collisions = layer.collisions(vertices)
            if len(collisions):
                squared = collisions.compute_minimum_distance(layer.mesh, vertices)
                if squared <= layer.least**2 * (1 + LEAST_FREE):
                    return False
            if ipctk.has_intersections(layer.mesh, vertices):
                return False
        return True
