"""The contact mesh: the triangles of a fabric, with the images that periodic fabric may touch.

Positions of its vertices are linear in the unknowns of the fabric, images included: the image of a
node lies whole sides L_x and L_y away from it. So gradients and Hessians by vertices become those
by unknowns through one constant sparse matrix.

Each pair of cells is there once a period: a cell of the fabric is compared with other cells, and
with their images to the right, above, and above to the left.
"""

from dataclasses import dataclass
from functools import lru_cache

import ipctk
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.model.network import MeshShape
from knitlab.model.pattern import CELLS_PER_PERIOD

NEAR_CELLS = 2
"""Nodes within so many of the paper's cells of each other, along both axes, are near. A fold at its
rest angle brings them nearer than a thickness, without any force in the calibrated hinge."""
TRIANGLES = np.array([[[0, 0], [0, 1], [1, 1]], [[1, 1], [1, 0], [0, 0]]])
"""Triangles of a cell by corner (y, x), as in :mod:`knitlab.measure.intersections`."""


@dataclass(frozen=True, eq=False)
class ContactMesh:
    """Vertices and triangles of a mesh shape, and which of them may touch.

    Attributes:
        shape: the mesh shape.
        from_unknowns: matrix from unknowns to the coordinates of the vertices, vertex by vertex.
        far: collision mesh of parts that are not near each other on the grid.
        near: collision mesh of parts that are.
    """

    shape: MeshShape
    from_unknowns: sp.csr_array
    far: ipctk.CollisionMesh
    near: ipctk.CollisionMesh

    def vertices(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "vertex 3"]:
        """Positions of the vertices in a configuration [mm]."""
        return np.asfortranarray((self.from_unknowns @ unknowns).reshape(-1, 3))


@lru_cache(maxsize=4)
def contact_mesh(shape: MeshShape, cells_per_period: int = CELLS_PER_PERIOD) -> ContactMesh:
    """The contact mesh of a mesh shape.

    Args:
        shape: the mesh shape.
        cells_per_period: grid cells along one period of a stripe.
    """
    cells = _cells(shape)
    corners = cells[:, None, None] + TRIANGLES
    places, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    own = ((places >= 0) & (places < [shape.nodes_y, shape.nodes_x])).all(axis=1)
    # Images come last, as the library's filter of obstacles wants them.
    order = np.argsort(~own, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    places, faces = places[order], rank[number].reshape(-1, 3).astype(np.int32)
    from_unknowns = _from_unknowns(shape, places)
    rest = np.asfortranarray(np.pad(places[:, ::-1].astype(float), ((0, 0), (0, 1))))
    near = _near_pairs(places, NEAR_CELLS * cells_per_period // CELLS_PER_PERIOD)
    touching = ipctk.make_static_obstacle_filter(int(own.sum()))
    meshes = []
    for value in (False, True):
        mesh = ipctk.CollisionMesh(rest, ipctk.edges(faces), faces)
        explicit = dict.fromkeys(map(tuple, near.tolist()), value)
        mesh.can_collide = touching & ipctk.make_sparse_filter(explicit, not value)
        meshes.append(mesh)
    return ContactMesh(shape, from_unknowns, *meshes)


def _cells(shape: MeshShape) -> Int[np.ndarray, "cell 2"]:
    """Lower left corner (y, x) of each cell, and of the images that it is compared with."""
    rows, columns = shape.cells_y, shape.cells_x
    if not shape.periodic:
        return np.indices((rows, columns)).reshape(2, -1).T
    up, across = np.meshgrid(np.arange(2 * rows), np.arange(-columns, 2 * columns), indexing="ij")
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
