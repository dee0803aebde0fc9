"""Contact of a fabric with itself in equilibria: a barrier, and the mesh of what may touch.

The barrier grows without bound as parts come as near as they may: a sum over pairs of a node and a
triangle, and of two edges, times the area of a grid cell. Energy, derivatives and collision-free
steps are those of the IPC Toolkit (Li et al., ACM Trans. Graph. 39, 2020).

Periodic fabric is compared with itself and with its images to the right, above, and above to the
left, as wide a band of them as is within reach, so that each pair counts once a period. Pairs are
searched along the whole of a step and with a margin, so that they serve for later steps.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.model.contact_layers import TRIANGLES, ContactLayer, ContactLayers
from knitlab.model.energy import Evaluation
from knitlab.model.fabric import Configuration, Unknowns
from knitlab.model.network import LENGTHS, UPRIGHT, MeshShape

# Workers have one thread each; the library would take all cores in every one of them.
ipctk.set_num_threads(1)

MARGIN = 0.02  # motion before a new search, over the shortest side of a cell
KEPT_FRACTION = 0.5  # of a collision-free step, that is taken: the barrier is finite after it
MIN_CLEARANCE = 1e-12  # distance over the least allowed, less 1, below which fabric touches

Vertices = Float[np.ndarray, "vertex 3"]


@dataclass(frozen=True, eq=False)
class ContactMesh:
    """Vertices and triangles of a mesh shape, and which of them may touch."""

    shape: MeshShape
    band: int  # rows and columns of images, on each side that has any
    grid: Int[np.ndarray, "vertex 2"]  # row and column (y, x) of every vertex
    faces: Int[np.ndarray, "face 3"]
    near_cells: int  # rows and columns within which vertices are near each other
    own: Bool[np.ndarray, " vertex"]  # nodes of the fabric itself, not images
    kept: Int[np.ndarray, " vertex"]  # vertices among those of the whole mesh
    from_unknowns: sp.csr_array  # to the coordinates of the vertices, vertex by vertex

    @cached_property
    def whole(self) -> ipctk.CollisionMesh:
        """Collision mesh of all parts."""
        rest = np.pad(self.grid[:, ::-1].astype(float), ((0, 0), (0, 1)))
        return ipctk.CollisionMesh(np.asfortranarray(rest), ipctk.edges(self.faces), self.faces)

    def parts(self, near: bool) -> ipctk.CollisionMesh:
        """Collision mesh of the parts that are near each other on the grid, or that are not."""
        mesh = replace(self).whole  # of a copy, because a filter belongs to its mesh
        close = cKDTree(self.grid).query_pairs(self.near_cells, p=np.inf, output_type="ndarray")
        pairs = dict.fromkeys(zip(*close.T.tolist(), strict=True), near)
        mesh.can_collide = ipctk.make_sparse_filter(pairs, not near)
        return mesh

    @cached_property
    def images(self) -> "ContactMesh | None":
        """The mesh of the triangles and edges between images, whose pairs no filter leaves out."""
        faces = self.faces[~self.own[self.faces].any(axis=1)]
        if not len(faces):
            return None
        kept, number = np.unique(faces, return_inverse=True)
        coordinates = (3 * kept[:, None] + np.arange(3)).ravel()
        return replace(
            self,
            grid=self.grid[kept],
            faces=number.reshape(-1, 3).astype(np.int32),
            own=self.own[kept],
            kept=kept,
            from_unknowns=self.from_unknowns[coordinates],
        )

    def chosen(self, vertices: Vertices) -> Float[np.ndarray, "kept 3"]:
        """Positions of its vertices, among those of the whole mesh."""
        return np.asfortranarray(vertices[self.kept])

    def vertices(self, unknowns: Unknowns) -> Vertices:
        """Positions of the vertices in a configuration [mm]."""
        return np.asfortranarray((self.from_unknowns @ unknowns).reshape(-1, 3))

    def suffices(self, unknowns: Unknowns, reach: float) -> bool:
        """Whether images beyond the band, by their bounding box, are further away than a reach."""
        shape = self.shape
        band = self.band
        if not shape.periodic or band >= min(shape.cells_y, shape.cells_x):
            return True
        configuration = Configuration.of(unknowns, shape)
        vectors = lattice(shape) @ np.asarray(configuration.lengths)
        # Heights of the cell over its sides: images along one side do not change that over it.
        heights = np.linalg.det(vectors) / np.linalg.norm(vectors[:, ::-1], axis=0)
        normals = np.linalg.inv(vectors) * heights[:, None]
        plane = np.asarray(configuration.positions)[..., :2]
        x, y = (plane @ normals.T).transpose(2, 0, 1)
        length_x, length_y = heights.tolist()
        right = min(x[:, band:].min() + length_x, x.min() + 2 * length_x) - x.max()
        left = x.min() - max(x[:, :-band].max() - length_x, x.max() - 2 * length_x)
        above = min(y[band:].min() + length_y, y.min() + 2 * length_y) - y.max()
        return min(right, left, above) > reach


@lru_cache(maxsize=4)
def contact_mesh(shape: MeshShape, band: int, near_cells: int) -> ContactMesh:
    """The contact mesh of a mesh shape; the band of images is at most a whole period of them."""
    corners = _cells(shape, band)[:, None, None] + TRIANGLES
    grid, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    inside = (grid >= 0) & (grid < [shape.nodes_y, shape.nodes_x])
    return ContactMesh(
        shape=shape,
        band=band,
        grid=grid,
        faces=number.reshape(-1, 3).astype(np.int32),
        near_cells=near_cells,
        own=np.asarray(inside.all(axis=1)),
        kept=np.arange(len(grid)),
        from_unknowns=_from_unknowns(shape, grid),
    )


def _cells(shape: MeshShape, band: int) -> Int[np.ndarray, "cell 2"]:
    """Lower left corner (y, x) of each cell, and of the images that it is compared with."""
    rows = shape.cells_y
    columns = shape.cells_x
    if not shape.periodic:
        return np.argwhere(shape.has_fabric)
    above = min(band, rows)
    beside = min(band, columns)
    cells = np.indices((rows + above, columns + 2 * beside)).reshape(2, -1).T - [0, beside]
    left = (cells[:, 0] < rows) & (cells[:, 1] < 0)
    return cells[~left]


def _from_unknowns(shape: MeshShape, grid: Int[np.ndarray, "vertex 2"]) -> sp.csr_array:
    turns, nodes = np.divmod(grid, [shape.nodes_y, shape.nodes_x])
    node = nodes[:, 0] * shape.nodes_x + nodes[:, 1]
    count = len(grid)
    entries = np.ones(count), (np.arange(count), node)
    of_node = sp.kron(sp.csr_array(entries, shape=(count, shape.nodes)), sp.eye_array(3))
    of_lengths = np.zeros((count, 3, shape.lengths))
    of_lengths[:, :2] = np.einsum("ckl,vk->vcl", lattice(shape), turns[:, ::-1])
    return sp.csr_array(sp.hstack([of_node, sp.csr_array(of_lengths.reshape(3 * count, -1))]))


def lattice(shape: MeshShape) -> Float[np.ndarray, "2 2 length"]:
    """Lattice vectors, as the columns of a matrix, by the lengths: of component, vector, length."""
    by_lengths = np.zeros((2, 2, shape.lengths))
    frame = np.array(shape.frame or UPRIGHT)
    for number, component, along in LENGTHS[: shape.lengths]:
        by_lengths[component, :, number] += frame[along]
    return by_lengths


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
    def between_images(self) -> ipctk.Candidates:
        """Those of two images, which are not part of the fabric."""
        return self._searched(1)

    def _searched(self, number: int) -> ipctk.Candidates:
        mesh, parts = self.meshes[number]
        found = ipctk.Candidates()
        found.build(parts, mesh.chosen(self.start), mesh.chosen(self.end), self.within / 2)
        return found

    def complete_within(self, *way: Vertices) -> float:
        """Distance up to which they are complete on another straight way, or NaN [mm]."""
        moved = self.end - self.start
        start = self.start
        length = float(np.vdot(moved, moved))
        if length:
            start = start + moved * np.clip(np.vdot(way[0] - start, moved) / length, 0.0, 1.0)
        return min(remaining_distance(self.within, start, each) for each in way)


class PairSearch:
    """Search of the pairs of parts that are near each other on the grid, or of all others."""

    def __init__(self, mesh: ContactMesh, near: bool, layer: ContactLayer, cell: float) -> None:
        self.mesh = mesh
        self.layer = layer
        self.potential = ipctk.BarrierPotential(layer.reach, layer.strength, False)
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
        candidates = self.close(*way).all
        _, parts = self._meshes[0]
        return candidates.compute_collision_free_stepsize(
            parts, *way, self.layer.least, ipctk.AdditiveCCD()
        )

    def touching(self, unknowns: Unknowns) -> Iterator[tuple[int, ContactMesh, Touching]]:
        """What is within reach of the barrier: 1 and the whole mesh, then −1 and the images."""
        vertices = self.mesh.vertices(unknowns)
        pairs = self.close(vertices)
        for sign, (mesh, parts) in zip((1, -1), self._meshes, strict=False):
            candidates = pairs.all if sign > 0 else pairs.between_images
            collisions = ipctk.NormalCollisions()
            positions = mesh.chosen(vertices)
            collisions.build(candidates, parts, positions, self.layer.reach, self.layer.least)
            if not len(collisions):
                break
            yield sign, mesh, (collisions, parts, positions)


def remaining_distance(distance: float, before: Vertices, after: Vertices) -> float:
    """A distance that is left after a motion, by its stretch along x and y and the rest; or NaN."""
    stretch = np.ones(3)
    stretch[:2] = np.ptp(after[:, :2], axis=0) / np.ptp(before[:, :2], axis=0)
    rest = after - before * stretch
    rest -= (rest.min(axis=0) + rest.max(axis=0)) / 2
    nearer = 2 * float(np.sqrt(np.einsum("vc,vc->v", rest, rest).max()))
    return distance * min(float(stretch.min()), 1.0) - nearer


class Barrier:
    """Contact of one fabric with itself, without friction."""

    def __init__(self, shape: MeshShape, layers: ContactLayers) -> None:
        self._shape = shape
        self._layers = layers
        # Parts that are near on the grid are near their own images only.
        self._near = self._search(layers.near_cells + 1, layers.near)
        self._far = self._search(layers.cells_per_period, layers.far)

    def on(self, shape: MeshShape) -> "Barrier":
        """The barrier of the same fabric, with the unknowns of another mesh shape."""
        return self if shape == self._shape else Barrier(shape, self._layers)

    def _search(self, band: int, layer: ContactLayer) -> PairSearch:
        mesh = contact_mesh(self._shape, band, self._layers.near_cells)
        return PairSearch(mesh, layer is self._layers.near, layer, self._layers.cell)

    def _searches(self, *configurations: Unknowns) -> tuple[PairSearch, PairSearch]:
        """Searches with a band of images that is wide enough for all configurations."""
        reach = self._layers.far.begins
        while not all(self._far.mesh.suffices(unknowns, reach) for unknowns in configurations):
            band = self._far.mesh.band + self._layers.cells_per_period
            self._far = self._search(band, self._layers.far)
        return self._far, self._near

    def evaluate(self, unknowns: Unknowns) -> tuple[float, Unknowns]:
        """Energy of the barrier [N mm], and its gradient [N]."""
        energy = 0.0
        gradient = np.zeros(len(unknowns))
        for search in self._searches(unknowns):
            for sign, mesh, touching in search.touching(unknowns):
                energy += sign * search.potential(*touching)
                gradient += sign * (mesh.from_unknowns.T @ search.potential.gradient(*touching))
        return energy, gradient

    def added(self, evaluation: Evaluation, unknowns: Unknowns) -> Evaluation:
        """An evaluation with energy and gradient of the barrier added."""
        energy, gradient = self.evaluate(unknowns)
        if not energy:
            return evaluation
        total: Any = np.asarray(evaluation.gradient) + gradient
        return Evaluation(replace(evaluation.energy, contact=energy), total)

    def hessian(
        self, unknowns: Unknowns, free: Int[np.ndarray, " free"], exact: bool = False
    ) -> sp.csc_array | None:
        """Both triangles [N/mm], positive semidefinite unless ``exact``; None if none touch."""
        kind = ipctk.PSDProjectionMethod
        projection = kind.NONE if exact else kind.CLAMP
        terms = []
        for search in self._searches(unknowns):
            for sign, mesh, touching in search.touching(unknowns):
                of_free = mesh.from_unknowns[:, free]
                by_vertex = sign * search.potential.hessian(*touching, projection)
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
                if squared <= search.layer.least**2 * (1 + MIN_CLEARANCE):
                    return False
        mesh = self._far.mesh
        return not ipctk.has_intersections(mesh.whole, mesh.vertices(unknowns))
