"""The barrier: a potential that grows without bound as parts come as near as they may.

Energy, gradient, Hessian and collision-free steps are those of the IPC Toolkit (Li et al.,
Incremental Potential Contact, ACM Trans. Graph. 39, 2020): a sum over pairs of a node and a
triangle, and of two edges. Each pair stands for a part of the sheet, so that the sum is multiplied
by the area of a grid cell.

Most of a fabric is out of reach of itself, and moves little in a step of the solver. So pairs are
searched with a margin and kept until vertices may have moved further than that: first those of the
whole mesh, with a wide margin, and among them those of the parts that are close, with a narrow one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.fabric.contact_mesh import ContactMesh, contact_mesh, without_pairs_of_images
from knitlab.fabric.energy import Evaluation
from knitlab.fabric.network import MeshShape
from knitlab.fabric.pattern import CELLS_PER_PERIOD
from knitlab.fabric.settings import CONTACT_RANGE

# Workers have one thread each; the library would take all cores in every one of them.
ipctk.set_num_threads(1)

NEAR_RANGE = 0.1
"""Distance over which the barrier acts between parts that are near on the grid, in thicknesses: it
keeps them from passing through each other, and leaves the calibrated folds alone."""
WIDE, NARROW = 0.3, 0.06  # margins before a new search, over the shortest side of a cell
KEPT_FRACTION = 0.5  # of a collision-free step, that is taken: the barrier is finite after it
LEAST_FREE = 1e-12  # distance over the least allowed, less 1, below which fabric touches

Unknowns = Float[np.ndarray, " unknown"]
Vertices = Float[np.ndarray, "vertex 3"]
Touching = tuple[ipctk.NormalCollisions, ipctk.CollisionMesh, Float[np.ndarray, "kept 3"]]
"""Pairs within reach of the barrier, their collision mesh, and the positions of its vertices."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of parts, complete up to a distance at one configuration."""

    mesh: ContactMesh  # whose parts they are
    parts: ipctk.CollisionMesh  # those near on the grid, or those that are not
    kept: Int[np.ndarray, " kept"]  # vertices of it among those of the whole mesh
    at: Vertices  # positions of all vertices [mm]
    within: float  # all other pairs were at least so far apart [mm]
    candidates: ipctk.Candidates = field(default_factory=ipctk.Candidates)

    def complete_within(self, vertices: Vertices) -> float:
        """Distance up to which they are complete at another configuration [mm]."""
        return shortened(self.within, self.at, vertices)

    def positions(self, vertices: Vertices) -> Float[np.ndarray, "kept 3"]:
        """Positions of the vertices of the mesh, among those of all."""
        return np.asfortranarray(vertices[self.kept])


class PairSearch:
    """Search of the pairs of parts that are near each other on the grid, or of those that are not.

    They keep the distance ``least``; the barrier acts over a ``reach`` beyond it [mm].
    """

    def __init__(
        self, mesh: ContactMesh, near: bool, least: float, reach: float, cell: float
    ) -> None:
        self.least, self.reach, self._near = least, reach, near
        self._mesh, self._every = mesh, np.arange(len(mesh.grid))
        self._parts = mesh.parts(near)
        self._reached = least + reach
        self._wide, self._narrow = (2 * margin * cell for margin in (WIDE, NARROW))
        # Complete nowhere, so that the first call searches.
        self._all = self._close = self._of_whole(np.full((len(mesh.grid), 3), np.nan), 0.0)

    def close(self, vertices: Vertices) -> Pairs:
        """Pairs among which all are that are within reach, each once."""
        if not self._close.complete_within(vertices) > self._reached:
            self._close = self._closest(vertices)
        return self._close

    def free_fraction(self, before: Vertices, after: Vertices) -> float:
        """Fraction of a straight step that brings no parts as near as they may be."""
        pairs = self.close(before)
        if not pairs.complete_within(after) > self.least:
            pairs = self._search(before)
        if not pairs.complete_within(after) > self.least:
            pairs = self._of_whole(before, np.inf)
            pairs.candidates.build(pairs.parts, before, after, self._reached / 2)
        if not len(pairs.candidates):
            return 1.0
        ends = pairs.positions(before), pairs.positions(after)
        return pairs.candidates.compute_collision_free_stepsize(
            pairs.parts, *ends, self.least, ipctk.AdditiveCCD()
        )

    def _of_whole(self, vertices: Vertices, within: float) -> Pairs:
        return Pairs(self._mesh, self._parts, self._every, vertices, within)

    def _search(self, vertices: Vertices) -> Pairs:
        """Pairs of the whole mesh, those of two images included."""
        if not self._all.complete_within(vertices) > self._reached:
            self._all = self._of_whole(vertices, self._reached + self._wide)
            self._all.candidates.build(self._all.parts, vertices, self._all.within / 2)
        return self._all

    def _closest(self, vertices: Vertices) -> Pairs:
        """Pairs of the parts around the vertices that are close to any other; mostly none."""
        pairs = self._search(vertices)
        complete = pairs.complete_within(vertices)
        distances = self.least + pairs.candidates.compute_per_vertex_safe_distances(
            pairs.parts, vertices, complete, self.least
        )
        nearest = min(float(distances.min()), complete)
        if nearest > self._reached:
            return self._of_whole(vertices, nearest)
        within = min(self._reached + self._narrow, complete)
        mesh, kept = self._mesh.around(distances <= within)
        closest = Pairs(mesh, mesh.parts(self._near), kept, vertices, within)
        closest.candidates.build(closest.parts, closest.positions(vertices), within / 2)
        without_pairs_of_images(closest.candidates, closest.parts, mesh.own)
        return closest


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
        self._shape, self._thickness, self._cells_per_period = shape, thickness, cells_per_period
        self._numbers = thickness, pressure, cell, cells_per_period
        self._force, self._cell = pressure * cell[0] * cell[1], min(cell)
        self._use(cells_per_period)

    def on(self, shape: MeshShape) -> "Barrier":
        """The barrier of the same fabric, with the unknowns of another mesh shape."""
        return self if shape == self._shape else Barrier(shape, *self._numbers)

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

    def _vertices(self, *configurations: Unknowns) -> list[Vertices]:
        """Vertices of the contact mesh, with a band of images that is wide enough for all."""
        reach = (1 + CONTACT_RANGE) * self._thickness
        while not all(self._mesh.suffices(unknowns, reach) for unknowns in configurations):
            self._use(2 * self._mesh.band)
        return [self._mesh.vertices(unknowns) for unknowns in configurations]

    def added(self, evaluation: Evaluation, unknowns: Unknowns) -> Evaluation:
        """An evaluation with energy and gradient of the barrier added."""
        energy, gradient = 0.0, np.zeros(len(unknowns))
        for search, mesh, touching in self._touching(unknowns):
            potential = self._potential(search)
            energy += potential(*touching)
            gradient += mesh.from_unknowns.T @ potential.gradient(*touching)
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
        for search, mesh, touching in self._touching(unknowns):
            potential, of_free = self._potential(search), mesh.from_unknowns[:, free]
            by_vertex = potential.hessian(*touching, projection)
            terms.append(of_free.T @ sp.csr_array(by_vertex) @ of_free)
        return sp.csc_array(sum(terms[1:], terms[0])) if terms else None

    def free_fraction(self, unknowns: Unknowns, step: Unknowns) -> float:
        """Fraction of a step, at most 1, after which all parts still keep their distance."""
        before, after = self._vertices(unknowns, unknowns + step)
        fraction = min(search.free_fraction(before, after) for search in self._searches)
        return fraction if fraction == 1 else KEPT_FRACTION * fraction

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
