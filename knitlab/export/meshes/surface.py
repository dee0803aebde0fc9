"""Surfaces: nodes, faces, and fields on them; of a sheet of quads, and of the solid around it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.io.errors import invalid

TRIANGLES_OF_QUAD = np.array([[0, 1, 2], [2, 3, 0]])
"""Corners of the two triangles of a quad: those by which self-intersections are counted."""
MITRE_LIMIT = 4.0
"""Largest distance of a node from the sheet, over that of the faces beside it; a fold whose flanks
enclose 29° reaches it."""
MIN_LENGTH = 1e-12  # length of a vector that points nowhere: of a crushed cell, or opposite normals


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

    def edges(self) -> tuple[Int[np.ndarray, "edge 2"], Int[np.ndarray, "edge 2"]]:
        """Edges in the direction of the face on their left, and the faces left and right, or -1."""
        sides = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        face = np.arange(len(sides)) // self.faces.shape[1]
        _, first, edge = np.unique(
            np.sort(sides, axis=1), return_index=True, return_inverse=True, axis=0
        )
        second = np.delete(np.arange(len(sides)), first)
        right = np.full(len(first), -1)
        right[edge.ravel()[second]] = face[second]
        order = np.argsort(first)
        return sides[first[order]], np.stack([face[first], right], axis=1)[order]

    def rim(self) -> tuple[Int[np.ndarray, "edge 2"], Int[np.ndarray, " edge"]]:
        """Edges of one face alone, in the direction of that face, and its number."""
        edges, faces = self.edges()
        alone = faces[:, 1] < 0
        return edges[alone], faces[alone, 0]

    def normals(self) -> Float[np.ndarray, "face 3"]:
        """Unit normals of the faces; of a quad, at right angles to its diagonals."""
        corners = self.nodes[self.faces]
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), MIN_LENGTH)

    def fold_angles(self) -> Float[np.ndarray, " edge"]:
        """Angle between the faces of every edge, 0 if flat or at the rim, a valley positive [°]."""
        edges, faces = self.edges()
        along = self.nodes[edges[:, 1]] - self.nodes[edges[:, 0]]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), MIN_LENGTH)
        # Quads need not be plane, nor their normals at right angles to their sides.
        left, right = (
            normal - (normal * along).sum(axis=1, keepdims=True) * along
            for normal in self.normals()[faces].swapaxes(0, 1)
        )
        turn = (np.cross(right, left) * along).sum(axis=1)
        angles = np.degrees(np.arctan2(turn, (left * right).sum(axis=1)))
        return np.where(faces[:, 1] < 0, 0, angles)


def grid_surface(
    nodes: Float[np.ndarray, "node_y node_x 3"],
    node_fields: Mapping[str, np.ndarray] = {},
    face_fields: Mapping[str, np.ndarray] = {},
    has_fabric: Bool[np.ndarray, "cell_y cell_x"] | None = None,
) -> SurfaceMesh:
    """The surface of a grid of nodes [mm], with fields on its nodes and on its cells.

    It has a quad for each cell, or for each that has fabric.
    """
    number = np.arange(nodes.shape[0] * nodes.shape[1]).reshape(nodes.shape[:2])
    corners = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.stack(corners, axis=-1).reshape(-1, 4)
    cells, kept = np.arange(len(faces)), number.ravel()
    if has_fabric is not None:
        cells = np.flatnonzero(has_fabric)
        kept, faces = np.unique(faces[cells], return_inverse=True)
    return SurfaceMesh(
        nodes.reshape(-1, 3)[kept],
        faces.reshape(-1, 4),
        {name: np.ravel(values)[kept] for name, values in node_fields.items()},
        {name: np.ravel(values)[cells] for name, values in face_fields.items()},
    )


def solid_of(sheet: SurfaceMesh, thickness: float) -> SurfaceMesh:
    """The solid of a sheet, half of its thickness [mm] on either side, along mitred normals."""
    if not thickness > 0:
        raise invalid(f"thickness {thickness:g}", "must be above 0 mm")
    most = largest_thickness(sheet)
    if thickness >= most:
        digit = 10.0 ** (math.floor(math.log10(most)) - 1)
        rounded = math.floor(most / digit) * digit
        message = f"is too large for folds and cells of this size; give at most {rounded:g} mm"
        raise invalid(f"thickness {thickness:g}", message)
    offset = thickness / 2 * mitred_normals(sheet)
    count = len(sheet.nodes)
    edges, beside = sheet.rim()
    start, end = edges.T
    wall = np.stack([end, start, start + count, end + count], axis=-1)
    # Beginning at the same corner, a face has the same diagonal on both sides.
    below = np.roll(sheet.faces[:, ::-1], 1, axis=1) + count
    of_faces = sheet.face_fields.items()
    return SurfaceMesh(
        np.concatenate([sheet.nodes + offset, sheet.nodes - offset]),
        np.concatenate([sheet.faces, below, wall]),
        {name: np.concatenate([values] * 2) for name, values in sheet.node_fields.items()},
        {name: np.concatenate([values, values, values[beside]]) for name, values in of_faces},
    )


def mitred_normals(sheet: SurfaceMesh) -> Float[np.ndarray, "node 3"]:
    """How far nodes move where faces move by 1 along their normals, up to MITRE_LIMIT."""
    normals = sheet.normals()
    node = sheet.faces.ravel()
    face = np.repeat(np.arange(len(normals)), 4)
    total = np.zeros_like(sheet.nodes)
    np.add.at(total, node, normals[face])
    direction = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), MIN_LENGTH)
    cosine = (normals[face] * direction[node]).sum(axis=1)
    sums, squares = (np.bincount(node, cosine**power, len(total)) for power in (1, 2))
    return np.clip(sums / np.maximum(squares, MIN_LENGTH), 0, MITRE_LIMIT)[:, None] * direction


def largest_thickness(sheet: SurfaceMesh) -> float:
    """Thickness at which a face of a side turns over, or that is the width of the sheet [mm]."""
    # The area of a triangle whose corners move by s along their offsets is a + b s + c s².
    triangles = sheet.triangulated().faces
    points = sheet.nodes[triangles]
    offsets = mitred_normals(sheet)[triangles]
    side, other = (points[:, k] - points[:, 0] for k in (1, 2))
    turn, other_turn = (offsets[:, k] - offsets[:, 0] for k in (1, 2))
    normal = np.cross(side, other)
    first_order = np.cross(turn, other) + np.cross(side, other_turn)
    changes = (normal, first_order, np.cross(turn, other_turn))
    area, linear, square = ((normal * change).sum(axis=1) for change in changes)
    discriminant = linear**2 - 4 * area * square
    turns = (area > 0) & (discriminant >= 0)
    # The least root, on either side, in the form in which no digits cancel.
    with np.errstate(divide="ignore"):
        turned = 2 * area[turns] / (np.sqrt(discriminant[turns]) + abs(linear[turns]))
    return float(min(2 * turned.min(initial=np.inf), np.sort(sheet.size)[1]))
