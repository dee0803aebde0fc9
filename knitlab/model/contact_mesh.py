"""The contact mesh: the triangles of a fabric, with the images that periodic fabric may touch.

Positions of its vertices are linear in the unknowns of the fabric, images included: the image of a
node lies whole periods away from it, along L_x and L_y or along the vectors of a sheared lattice.
Each pair of parts counts once a period: parts of
the fabric are compared with each other, and with the images to the right, above, and above to the
left. Only a band of images is needed, as long as what lies beyond is out of reach.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from knitlab.model.contact_layers import NEAR_CELLS, TRIANGLES
from knitlab.model.fabric import Configuration
from knitlab.model.network import LENGTHS, UPRIGHT, MeshShape
from knitlab.model.pattern import CELLS_PER_PERIOD


@dataclass(frozen=True, eq=False)
class ContactMesh:
    """Vertices and triangles of a mesh shape, and which of them may touch."""

    shape: MeshShape
    band: int  # rows and columns of images, on each side that has any
    grid: Int[np.ndarray, "vertex 2"]  # row and column (y, x) of every vertex
    faces: Int[np.ndarray, "face 3"]
    near_reach: int  # rows and columns within which vertices are near each other
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
        close = cKDTree(self.grid).query_pairs(self.near_reach, p=np.inf, output_type="ndarray")
        pairs = dict.fromkeys(zip(*close.T.tolist(), strict=True), near)
        mesh.can_collide = ipctk.make_sparse_filter(pairs, not near)
        return mesh

    @cached_property
    def images(self) -> "ContactMesh | None":
        """The mesh of the triangles and edges between images; None if there are none.

        No filter of a collision mesh leaves out just their pairs: it asks for each pair of vertices
        by itself.
        """
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

    def chosen(self, vertices: Float[np.ndarray, "vertex 3"]) -> Float[np.ndarray, "kept 3"]:
        """Positions of its vertices, among those of the whole mesh."""
        return np.asfortranarray(vertices[self.kept])

    def vertices(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "vertex 3"]:
        """Positions of the vertices in a configuration [mm]."""
        return np.asfortranarray((self.from_unknowns @ unknowns).reshape(-1, 3))

    def suffices(self, unknowns: Float[np.ndarray, " unknown"], reach: float) -> bool:
        """Whether images beyond the band, by their bounding box, are further away than a reach."""
        shape, band = self.shape, self.band
        if not shape.periodic or band >= min(shape.cells_y, shape.cells_x):
            return True
        configuration = Configuration.of(unknowns, shape)
        vectors = lattice(shape) @ np.asarray(configuration.lengths)
        # Heights of the cell over its sides: images along one side do not change that over it.
        area = np.linalg.det(vectors)
        heights = area / np.linalg.norm(vectors[:, ::-1], axis=0)
        normals = np.linalg.inv(vectors) * heights[:, None]
        plane = np.asarray(configuration.positions)[..., :2]
        x, y = (plane @ normals.T).transpose(2, 0, 1)
        length_x, length_y = heights.tolist()
        right = min(x[:, band:].min() + length_x, x.min() + 2 * length_x) - x.max()
        left = x.min() - max(x[:, :-band].max() - length_x, x.max() - 2 * length_x)
        above = min(y[band:].min() + length_y, y.min() + 2 * length_y) - y.max()
        return min(right, left, above) > reach


@lru_cache(maxsize=4)
def contact_mesh(
    shape: MeshShape, band: int, cells_per_period: int = CELLS_PER_PERIOD
) -> ContactMesh:
    """The contact mesh of a mesh shape; the band of images is at most a whole period of them."""
    corners = _cells(shape, band)[:, None, None] + TRIANGLES
    grid, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    inside = (grid >= 0) & (grid < [shape.nodes_y, shape.nodes_x])
    return ContactMesh(
        shape=shape,
        band=band,
        grid=grid,
        faces=number.reshape(-1, 3).astype(np.int32),
        near_reach=NEAR_CELLS * cells_per_period // CELLS_PER_PERIOD,
        own=np.asarray(inside.all(axis=1)),
        kept=np.arange(len(grid)),
        from_unknowns=_from_unknowns(shape, grid),
    )


def _cells(shape: MeshShape, band: int) -> Int[np.ndarray, "cell 2"]:
    """Lower left corner (y, x) of each cell, and of the images that it is compared with."""
    rows, columns = shape.cells_y, shape.cells_x
    if not shape.periodic:
        return np.indices((rows, columns)).reshape(2, -1).T
    above, beside = min(band, rows), min(band, columns)
    cells = np.indices((rows + above, columns + 2 * beside)).reshape(2, -1).T - [0, beside]
    left = (cells[:, 0] < rows) & (cells[:, 1] < 0)
    return cells[~left]


def _from_unknowns(shape: MeshShape, grid: Int[np.ndarray, "vertex 2"]) -> sp.csr_array:
    turns, nodes = np.divmod(grid, [shape.nodes_y, shape.nodes_x])
    node, count = nodes[:, 0] * shape.nodes_x + nodes[:, 1], len(grid)
    entries = np.ones(count), (np.arange(count), node)
    of_node = sp.kron(sp.csr_array(entries, shape=(count, shape.nodes)), sp.eye_array(3))
    of_lengths = np.zeros((count, 3, shape.lengths))
    of_lengths[:, :2] = np.einsum("ckl,vk->vcl", lattice(shape), turns[:, ::-1])
    return sp.csr_array(sp.hstack([of_node, sp.csr_array(of_lengths.reshape(3 * count, -1))]))


def lattice(shape: MeshShape) -> Float[np.ndarray, "2 2 length"]:
    """Lattice vectors, as the columns of a matrix, by the lengths: of component, vector, length."""
    by_lengths, frame = np.zeros((2, 2, shape.lengths)), np.array(shape.frame or UPRIGHT)
    for number, component, along in LENGTHS[: shape.lengths]:
        by_lengths[component, :, number] += frame[along]
    return by_lengths
