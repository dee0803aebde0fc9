"""The contact mesh: the triangles of a fabric, with the images that periodic fabric may touch.

Positions of its vertices are linear in the unknowns of the fabric, images included: the image of a
node lies whole sides L_x and L_y away from it. So gradients and Hessians by vertices become those
by unknowns through one constant sparse matrix.

Each pair of parts counts once a period: parts of the fabric are compared with each other, and with
the images to the right, above, and above to the left. Pairs of two images are left out. Only a band
of images beside the fabric is needed, as long as what lies beyond is out of reach.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape
from knitlab.fabric.pattern import CELLS_PER_PERIOD

NEAR_CELLS = 2
"""Nodes within this many of the paper's cells of each other, along both axes, are near. A fold at
its rest angle brings them nearer than a thickness, without any force but that of its hinge."""
TRIANGLES = np.array([[[0, 0], [0, 1], [1, 1]], [[1, 1], [1, 0], [0, 0]]])
"""Triangles of a cell by corner (y, x), as in :mod:`knitlab.measure.surfaces`."""


@dataclass(frozen=True, eq=False)
class ContactMesh:
    """Vertices and triangles of a mesh shape, and which of them may touch.

    Attributes:
        shape: the mesh shape.
        band: rows and columns of cells of the images, on each side that has any.
        places: row and column (y, x) of every vertex.
        faces: vertices of every triangle.
        near_reach: rows and columns within which vertices are near each other.
        own: which vertices are nodes of the fabric itself, rather than images.
        from_unknowns: matrix from unknowns to the coordinates of the vertices, vertex by vertex.
    """

    shape: MeshShape
    band: int
    places: Int[np.ndarray, "vertex 2"]
    faces: Int[np.ndarray, "face 3"]
    near_reach: int
    own: Bool[np.ndarray, " vertex"]
    from_unknowns: sp.csr_array

    @cached_property
    def whole(self) -> ipctk.CollisionMesh:
        """Collision mesh of all parts."""
        return self._collision_mesh()

    @cached_property
    def far(self) -> ipctk.CollisionMesh:
        """That of parts that are not near each other on the grid."""
        return self._filtered(are_near=False)

    @cached_property
    def near(self) -> ipctk.CollisionMesh:
        """That of parts that are near each other on the grid."""
        return self._filtered(are_near=True)

    def _collision_mesh(self) -> ipctk.CollisionMesh:
        rest = np.pad(self.places[:, ::-1].astype(float), ((0, 0), (0, 1)))
        return ipctk.CollisionMesh(np.asfortranarray(rest), ipctk.edges(self.faces), self.faces)

    def _filtered(self, are_near: bool) -> ipctk.CollisionMesh:
        mesh = self._collision_mesh()
        pairs = dict.fromkeys(zip(*self._near_pairs.T.tolist(), strict=True), are_near)
        mesh.can_collide = ipctk.make_sparse_filter(pairs, not are_near)
        return mesh

    @cached_property
    def _near_pairs(self) -> Int[np.ndarray, "pair 2"]:
        return _near_pairs(self.places, self.near_reach)

    def around(
        self, chosen: Bool[np.ndarray, " vertex"]
    ) -> tuple["ContactMesh", Int[np.ndarray, " part"]]:
        """The mesh of all triangles with a chosen vertex, and the numbers of its vertices."""
        faces = self.faces[chosen[self.faces].any(axis=1)]
        kept, number = np.unique(faces, return_inverse=True)
        coordinates = (3 * kept[:, None] + np.arange(3)).ravel()
        part = replace(
            self,
            places=self.places[kept],
            faces=number.reshape(-1, 3).astype(np.int32),
            own=self.own[kept],
            from_unknowns=self.from_unknowns[coordinates],
        )
        return part, kept

    def vertices(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "vertex 3"]:
        """Positions of the vertices in a configuration [mm]."""
        return np.asfortranarray((self.from_unknowns @ unknowns).reshape(-1, 3))

    def suffices(self, unknowns: Float[np.ndarray, " unknown"], reach: float) -> bool:
        """Whether images beyond the band are further away than a reach [mm].

        Their bounding box is compared with that of the fabric.
        """
        shape, band = self.shape, self.band
        if not shape.periodic or band >= min(shape.cells_y, shape.cells_x):
            return True
        configuration = Configuration.of(unknowns, shape)
        x, y = np.asarray(configuration.positions)[..., :2].transpose(2, 0, 1)
        length_x, length_y = (float(side) for side in configuration.lengths)
        right = min(x[:, band:].min() + length_x, x.min() + 2 * length_x) - x.max()
        left = x.min() - max(x[:, :-band].max() - length_x, x.max() - 2 * length_x)
        above = min(y[band:].min() + length_y, y.min() + 2 * length_y) - y.max()
        return min(right, left, above) > reach


@lru_cache(maxsize=4)
def contact_mesh(
    shape: MeshShape, band: int, cells_per_period: int = CELLS_PER_PERIOD
) -> ContactMesh:
    """The contact mesh of a mesh shape.

    Args:
        shape: the mesh shape.
        band: rows and columns of cells of the images; a whole period of them at most.
        cells_per_period: grid cells along one period of a stripe.
    """
    corners = _cells(shape, band)[:, None, None] + TRIANGLES
    places, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    inside = (places >= 0) & (places < [shape.nodes_y, shape.nodes_x])
    return ContactMesh(
        shape=shape,
        band=band,
        places=places,
        faces=number.reshape(-1, 3).astype(np.int32),
        near_reach=NEAR_CELLS * cells_per_period // CELLS_PER_PERIOD,
        own=np.asarray(inside.all(axis=1)),
        from_unknowns=_from_unknowns(shape, places),
    )


def without_pairs_of_images(
    candidates: ipctk.Candidates, parts: ipctk.CollisionMesh, own: Bool[np.ndarray, " vertex"]
) -> None:
    """Remove the candidates of which both parts are images.

    The filter of a collision mesh cannot: it asks for each pair of vertices by itself, and so would
    also lose pairs of which only the vertices that are not near each other are images.

    Args:
        candidates: pairs of a vertex and a triangle, and of two edges; changed in place.
        parts: the collision mesh whose parts they are.
        own: which of its vertices are not images.
    """
    if own.all():
        return
    own_vertices = own.tolist()
    own_faces, own_edges = (
        own[np.asarray(each)].any(axis=1).tolist() for each in (parts.faces, parts.edges)
    )
    candidates.fv_candidates = [
        pair
        for pair in candidates.fv_candidates
        if own_vertices[pair.vertex_id] or own_faces[pair.face_id]
    ]
    candidates.ee_candidates = [
        pair
        for pair in candidates.ee_candidates
        if own_edges[pair.edge0_id] or own_edges[pair.edge1_id]
    ]


def _cells(shape: MeshShape, band: int) -> Int[np.ndarray, "cell 2"]:
    """Lower left corner (y, x) of each cell, and of the images that it is compared with."""
    rows, columns = shape.cells_y, shape.cells_x
    if not shape.periodic:
        return np.indices((rows, columns)).reshape(2, -1).T
    up, across = np.meshgrid(
        np.arange(rows + min(band, rows)),
        np.arange(-min(band, columns), columns + min(band, columns)),
        indexing="ij",
    )
    places = np.stack([up.ravel(), across.ravel()], axis=1)
    below_left = (places[:, 0] < rows) & (places[:, 1] < 0)
    return places[~below_left]


def _from_unknowns(shape: MeshShape, places: Int[np.ndarray, "vertex 2"]) -> sp.csr_array:
    grid = np.array([shape.nodes_y, shape.nodes_x])
    turns, nodes = np.divmod(places, grid)
    node = nodes[:, 0] * shape.nodes_x + nodes[:, 1]
    vertex = np.arange(len(places))
    rows = [3 * vertex[:, None] + np.arange(3)]
    columns = [3 * node[:, None] + np.arange(3)]
    factors = [np.ones((len(places), 3))]
    for component, turn in enumerate((turns[:, 1], turns[:, 0])):
        moved = np.flatnonzero(turn)
        rows.append(3 * moved[:, None] + component)
        columns.append(np.full((len(moved), 1), 3 * shape.nodes + component))
        factors.append(turn[moved, None].astype(float))
    row, column, factor = (
        np.concatenate([part.ravel() for part in parts]) for parts in (rows, columns, factors)
    )
    return sp.csr_array((factor, (row, column)), shape=(3 * len(places), shape.unknowns))


def _near_pairs(places: Int[np.ndarray, "vertex 2"], reach: int) -> Int[np.ndarray, "pair 2"]:
    """Pairs of vertices, the lower number first, within a reach along both axes."""
    low = places.min(axis=0) - reach
    extent = places.max(axis=0) - low + reach + 1
    key = (places - low) @ np.array([extent[1], 1])
    order = np.argsort(key)
    steps = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
    pairs = []
    for step in steps[steps @ np.array([extent[1], 1]) > 0]:
        wanted = key + step @ np.array([extent[1], 1])
        at = np.minimum(np.searchsorted(key[order], wanted), len(order) - 1)
        found = np.flatnonzero(key[order[at]] == wanted)
        pairs.append(np.stack([found, order[at[found]]], axis=1))
    return np.sort(np.concatenate(pairs), axis=1)
