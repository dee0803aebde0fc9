"""The barrier: a potential that grows without bound as parts come as near as they may.

Energy, gradient, Hessian and collision-free steps are those of the IPC Toolkit (Li et al.,
Incremental Potential Contact, ACM Trans. Graph. 39, 2020): a sum over pairs of a node and a
triangle, and of two edges. Each pair stands for a part of the sheet, so that the sum is multiplied
by the area of a grid cell.

Pairs are searched along the whole of a step, so that they also serve for the states tried on it,
and with a margin, so that they serve for later steps until vertices may have moved further.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.model.contact_layers import ContactLayer, contact_layers
from knitlab.model.contact_mesh import ContactMesh, contact_mesh
from knitlab.model.energy import Evaluation
from knitlab.model.network import MeshShape
from knitlab.model.pattern import CELLS_PER_PERIOD

# Workers have one thread each; the library would take all cores in every one of them.
ipctk.set_num_threads(1)

MARGIN = 0.02  # motion before a new search, over the shortest side of a cell
KEPT_FRACTION = 0.5  # of a collision-free step, that is taken: the barrier is finite after it
LEAST_FREE = 1e-12  # distance over the least allowed, less 1, below which fabric touches

Unknowns = Float[np.ndarray, " unknown"]
Vertices = Float[np.ndarray, "vertex 3"]
Meshes = Sequence[tuple[ContactMesh, ipctk.CollisionMesh]]
Touching = tuple[ipctk.NormalCollisions, ipctk.CollisionMesh, Vertices]
"""Pairs within reach of the barrier, their collision mesh, and the positions of its vertices."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """All pairs of parts that come within a distance on the way between two configurations."""

    meshes: Meshes  # the whole mesh, and that of the images
    start: Vertices
    end: Vertices
    within: float  # [mm]

    @cached_property
    def all(self) -> ipctk.Candidates:
        """All pairs."""
        return self._searched(0)

    @cached_property
    def of_images(self) -> ipctk.Candidates:
        """Those of two images, which are not part of the fabric."""
        return self._searched(1)

    def _searched(self, number: int) -> ipctk.Candidates:
        mesh, parts = self.meshes[number]
        found = ipctk.Candidates()
        ends = mesh.chosen(self.start), mesh.chosen(self.end)
        found.build(parts, *ends, self.within / 2)
        return found

    def complete_within(self, *way: Vertices) -> float:
        """Distance up to which they are complete on another straight way, or NaN [mm]."""
        moved, start = self.end - self.start, self.start
        length = float(np.vdot(moved, moved))
        if length:
            start = start + moved * np.clip(np.vdot(way[0] - start, moved) / length, 0.0, 1.0)
        return min(shortened(self.within, start, each) for each in way)


class PairSearch:
    """Search of the pairs of parts that are near each other on the grid, or of those that are not.

    Pairs are those of the whole mesh and, to be subtracted, of two images.
    """

    def __init__(self, mesh: ContactMesh, near: bool, layer: ContactLayer, cell: float) -> None:
        self.mesh, self.layer = mesh, layer
        meshes = (mesh, mesh.images)
        self._meshes = [(each, each.parts(near)) for each in meshes if each is not None]
        self._margin = 2 * MARGIN * cell
        nowhere = np.full((len(mesh.grid), 3), np.nan)
        self._pairs = Pairs(self._meshes, nowhere, nowhere, 0.0)

    def close(self, *way: Vertices) -> Pairs:
        """Pairs among which all are that are within reach on a straight way."""
        if not self._pairs.complete_within(*way) > self.layer.begins:
            within = self.layer.begins + self._margin
            self._pairs = Pairs(self._meshes, way[0], way[-1], within)
        return self._pairs

    def free_fraction(self, before: Unknowns, after: Unknowns) -> float:
        """Fraction of a straight step that brings no parts as near as they may be."""
        way = self.mesh.vertices(before), self.mesh.vertices(after)
        candidates, (_, parts) = self.close(*way).all, self._meshes[0]
        return candidates.compute_collision_free_stepsize(
            parts, *way, self.layer.least, ipctk.AdditiveCCD()
        )

    def touching(self, unknowns: Unknowns) -> Iterator[tuple[int, ContactMesh, Touching]]:
        """What is within reach of the barrier: 1 and the whole mesh, then −1 and the images."""
        vertices = self.mesh.vertices(unknowns)
        pairs = self.close(vertices)
        for sign, (mesh, parts) in zip((1, -1), self._meshes, strict=False):
            candidates = pairs.all if sign > 0 else pairs.of_images
            collisions, positions = ipctk.NormalCollisions(), mesh.chosen(vertices)
            collisions.build(candidates, parts, positions, self.layer.reach, self.layer.least)
            if not len(collisions):
                break
            yield sign, mesh, (collisions, parts, positions)


def shortened(distance: float, before: Vertices, after: Vertices) -> float:
    """A distance that is left after a motion, by its stretch along x and y and the rest; or NaN."""
    stretch = np.ones(3)
    stretch[:2] = np.ptp(after[:, :2], axis=0) / np.ptp(before[:, :2], axis=0)
    rest = after - before * stretch
    rest -= (rest.min(axis=0) + rest.max(axis=0)) / 2
    nearer = 2 * float(np.sqrt(np.einsum("vc,vc->v", rest, rest).max()))
    return distance * min(float(stretch.min()), 1.0) - nearer


class Barrier:
    """Contact of one fabric with itself, without friction.

    ``thickness`` is the distance of the middle surfaces of two touching plies [mm], ``pressure``
    the scale of the barrier [N/mm²], and ``cell`` the mean sides (x, y) of a grid cell [mm].
    """

    def __init__(
        self,
        shape: MeshShape,
        thickness: float,
        pressure: float,
        cell: tuple[float, float],
        cells_per_period: int = CELLS_PER_PERIOD,
    ) -> None:
        self._shape, self._cells_per_period = shape, cells_per_period
        self._numbers = thickness, pressure, cell, cells_per_period
        self._layers = contact_layers(thickness, pressure, cell, cells_per_period)
        # Parts that are near on the grid are near their own images only.
        self._near = self._search(self._layers.near_cells + 1, self._layers.near)
        self._use(cells_per_period)

    def on(self, shape: MeshShape) -> "Barrier":
        """The barrier of the same fabric, with the unknowns of another mesh shape."""
        return self if shape == self._shape else Barrier(shape, *self._numbers)

    def _use(self, band: int) -> None:
        self._far = self._search(band, self._layers.far)

    def _search(self, band: int, layer: ContactLayer) -> PairSearch:
        mesh = contact_mesh(self._shape, band, self._cells_per_period)
        return PairSearch(mesh, layer is self._layers.near, layer, self._layers.cell)

    def _searches(self, *configurations: Unknowns) -> tuple[PairSearch, PairSearch]:
        """Searches with a band of images that is wide enough for all configurations."""
        reach = self._layers.far.begins
        while not all(self._far.mesh.suffices(unknowns, reach) for unknowns in configurations):
            self._use(self._far.mesh.band + self._cells_per_period)
        return self._far, self._near

    def added(self, evaluation: Evaluation, unknowns: Unknowns) -> Evaluation:
        """An evaluation with energy and gradient of the barrier added."""
        energy, gradient = 0.0, np.zeros(len(unknowns))
        for search in self._searches(unknowns):
            potential = self._potential(search)
            for sign, mesh, touching in search.touching(unknowns):
                energy += sign * potential(*touching)
                gradient += sign * (mesh.from_unknowns.T @ potential.gradient(*touching))
        if not energy:
            return evaluation
        total: Any = np.asarray(evaluation.gradient) + gradient
        return Evaluation(replace(evaluation.energy, contact=energy), total)

    def hessian(
        self, unknowns: Unknowns, free: Int[np.ndarray, " free"], exact: bool = False
    ) -> sp.csc_array | None:
        """Both triangles [N/mm]; None if no pairs are in reach.

        Unless ``exact``, each pair's share is made positive semidefinite, for a search.
        """
        kind = ipctk.PSDProjectionMethod
        projection, terms = kind.NONE if exact else kind.CLAMP, []
        for search in self._searches(unknowns):
            potential = self._potential(search)
            for sign, mesh, touching in search.touching(unknowns):
                of_free = mesh.from_unknowns[:, free]
                by_vertex = sign * potential.hessian(*touching, projection)
                terms.append(of_free.T @ sp.csr_array(by_vertex) @ of_free)
        return sp.csc_array(sum(terms[1:], terms[0])) if terms else None

    def free_fraction(self, unknowns: Unknowns, step: Unknowns) -> float:
        """Fraction of a step, at most 1, after which all parts still keep their distance."""
        way = unknowns, unknowns + step
        fraction = min(search.free_fraction(*way) for search in self._searches(*way))
        return fraction if fraction == 1 else KEPT_FRACTION * fraction

    def holds(self, unknowns: Unknowns) -> bool:
        """Whether all parts keep their distance, and nothing passes through anything."""
        for search in self._searches(unknowns):
            for _, _, (collisions, parts, positions) in search.touching(unknowns):
                squared = collisions.compute_minimum_distance(parts, positions)
                if squared <= search.layer.least**2 * (1 + LEAST_FREE):
                    return False
        mesh = self._far.mesh
        return not ipctk.has_intersections(mesh.whole, mesh.vertices(unknowns))

    def _potential(self, search: PairSearch) -> ipctk.BarrierPotential:
        return ipctk.BarrierPotential(search.layer.reach, search.layer.strength, False)
