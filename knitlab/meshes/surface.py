"""Surfaces: nodes, faces, and the fields on them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

TRIANGLES_OF_QUAD = np.array([[0, 1, 2], [2, 3, 0]])
"""Corners of the two triangles of a quad: those by which self-intersections are counted."""


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """A surface of quads or of triangles, with fields by their name and unit: ``height [mm]``."""

    nodes: Float[np.ndarray, "node 3"]  # positions (x, y, z) [mm]
    faces: Int[np.ndarray, "face corner"]  # anticlockwise from outside: a sheet's technical face
    node_fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    face_fields: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __repr__(self) -> str:
        fields = len(self.node_fields) + len(self.face_fields)
        return f"<SurfaceMesh: {len(self.nodes)} nodes, {len(self.faces)} faces, {fields} fields>"

    @property
    def size(self) -> Float[np.ndarray, "3"]:
        """Its extents along x, y and z [mm]."""
        return np.ptp(self.nodes, axis=0)

    def triangulated(self) -> "SurfaceMesh":
        """The surface with every quad divided into two triangles."""
        if self.faces.shape[1] == 3:
            return self
        return SurfaceMesh(
            self.nodes,
            self.faces[:, TRIANGLES_OF_QUAD].reshape(-1, 3),
            self.node_fields,
            {name: np.repeat(values, 2, axis=0) for name, values in self.face_fields.items()},
        )

    def rim(self) -> tuple[Int[np.ndarray, "edge 2"], Int[np.ndarray, " edge"]]:
        """Edges of one face alone, in the direction of that face, and its number."""
        edges = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        _, first, count = np.unique(
            np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
        )
        alone = np.sort(first[count == 1])
        return edges[alone], alone // self.faces.shape[1]


def grid_surface(
    nodes: Float[np.ndarray, "node_y node_x 3"],
    node_fields: Mapping[str, np.ndarray] = {},
    face_fields: Mapping[str, np.ndarray] = {},
) -> SurfaceMesh:
    """The surface of a grid of nodes: a quad for each grid cell, technical face outside.

    Positions are x along the courses and y along the wales [mm]; fields are values on the grid of
    nodes (node_y, node_x) and on that of cells (cell_y, cell_x), by their name and unit.
    """
    number = np.arange(nodes.shape[0] * nodes.shape[1]).reshape(nodes.shape[:2])
    corners = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    return SurfaceMesh(
        nodes.reshape(-1, 3),
        np.stack(corners, axis=-1).reshape(-1, 4),
        {name: np.ravel(values) for name, values in node_fields.items()},
        {name: np.ravel(values) for name, values in face_fields.items()},
    )
