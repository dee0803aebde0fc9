"""Search of the pairs of parts that are within reach of each other.

Most of a fabric is out of reach of itself, and moves little in a step of the solver. So pairs are
searched with a margin and kept until vertices may have moved further than that: first those of the
whole mesh, with a wide margin, and among them those of the parts that are close, with a narrow one.
While nothing can have come within reach, nothing is computed.
"""

from dataclasses import dataclass, field

import ipctk
import numpy as np
from jaxtyping import Float, Int

from knitlab.fabric.contact_mesh import ContactMesh, without_pairs_of_images

WIDE, NARROW = 0.3, 0.06
"""Margins: distance that vertices may move before a search, over the shortest side of a cell."""

Vertices = Float[np.ndarray, "vertex 3"]


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of parts, complete up to a distance at one configuration.

    Attributes:
        mesh: contact mesh whose parts they are.
        parts: its collision mesh, of the parts that are near on the grid or of those that are not.
        kept: its vertices among those of the whole contact mesh.
        at: positions of all vertices [mm].
        within: all other pairs were at least so far apart [mm].
        candidates: the pairs.
    """

    mesh: ContactMesh
    parts: ipctk.CollisionMesh
    kept: Int[np.ndarray, " part"]
    at: Vertices
    within: float
    candidates: ipctk.Candidates = field(default_factory=ipctk.Candidates)

    def complete_within(self, vertices: Vertices) -> float:
        """Distance up to which they are complete at another configuration [mm]."""
        return shortened(self.within, self.at, vertices)

    def positions(self, vertices: Vertices) -> Float[np.ndarray, "part 3"]:
        """Positions of the vertices of the mesh, among those of all."""
        return np.asfortranarray(vertices[self.kept])


class PairSearch:
    """Search of the pairs of parts that are near each other on the grid, or of those that are not.

    Args:
        mesh: the contact mesh.
        near: which of both.
        least: distance that they keep [mm].
        reach: distance beyond it over which the barrier acts [mm].
        cell: shortest side of a grid cell [mm].
    """

    def __init__(
        self, mesh: ContactMesh, near: bool, least: float, reach: float, cell: float
    ) -> None:
        self.least, self.reach, self._near = least, reach, near
        self._mesh, self._every = mesh, np.arange(len(mesh.grid))
        self._reached = least + reach
        self._wide, self._narrow = (2 * margin * cell for margin in (WIDE, NARROW))
        self._all = self._close = self._of_whole(np.full((len(mesh.grid), 3), np.nan), 0.0)

    def close(self, vertices: Vertices) -> Pairs:
        """Pairs among which all are that are within reach, each once."""
        if not self._close.complete_within(vertices) > self._reached:
            self._close = self._closest(vertices)
        return self._close

    def free_part(self, before: Vertices, after: Vertices) -> float:
        """Part of a straight step that brings no parts as near as they may be."""
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
        return Pairs(self._mesh, self._parts(self._mesh), self._every, vertices, within)

    def _parts(self, mesh: ContactMesh) -> ipctk.CollisionMesh:
        return mesh.near if self._near else mesh.far

    def _search(self, vertices: Vertices) -> Pairs:
        """Pairs of the whole mesh, those of two images included."""
        if not self._all.complete_within(vertices) > self._reached:
            self._all = self._of_whole(vertices, self._reached + self._wide)
            self._all.candidates.build(self._all.parts, vertices, self._all.within / 2)
        return self._all

    def _closest(self, vertices: Vertices) -> Pairs:
        """Pairs of the parts around the vertices that are close to any other part.

        In most configurations there are none, and no pair is closer than the closest of all.
        """
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
        closest = Pairs(mesh, self._parts(mesh), kept, vertices, within)
        closest.candidates.build(closest.parts, closest.positions(vertices), within / 2)
        without_pairs_of_images(closest.candidates, closest.parts, mesh.own)
        return closest


def shortened(distance: float, before: Vertices, after: Vertices) -> float:
    """What may be left of a distance between parts when the fabric moves; NaN if nothing is known.

    The motion is split into a stretch along x and y, which shortens a distance by at most that
    factor, and the rest, which brings two vertices nearer by at most twice its largest.
    """
    stretch = np.ones(3)
    stretch[:2] = np.ptp(after[:, :2], axis=0) / np.ptp(before[:, :2], axis=0)
    rest = after - before * stretch
    rest -= (rest.min(axis=0) + rest.max(axis=0)) / 2
    nearer = 2 * float(np.sqrt(np.einsum("vc,vc->v", rest, rest).max()))
    return distance * min(float(stretch.min()), 1.0) - nearer
