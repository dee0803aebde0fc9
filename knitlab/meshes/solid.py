"""Solids: a sheet with a thickness, closed all around."""

import math

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import fault
from knitlab.meshes.surface import SurfaceMesh

MITRE_LIMIT = 4.0
"""Largest distance of a node from the sheet, over that of the faces beside it; a fold whose flanks
enclose 29° reaches it."""
LEAST = 1e-12  # length of a vector that points nowhere: of a crushed cell, or opposite normals


def solid_of(sheet: SurfaceMesh, thickness: float) -> SurfaceMesh:
    """The solid of a sheet: half of its thickness [mm] lies on either side.

    Both sides are offset along mitred normals, so that flanks keep their thickness next to a fold,
    and joined by a wall along the rim. Fields are those of the sheet on both sides, and of the face
    beside it on the wall. The sheet is an oriented surface of quads. BadInput if the thickness is
    not above 0, or above :func:`largest_thickness`.
    """
    if not thickness > 0:
        raise fault(f"thickness {thickness:g}", "is not above 0 mm; give a thickness")
    most = largest_thickness(sheet)
    if thickness >= most:
        digit = 10.0 ** (math.floor(math.log10(most)) - 1)
        rounded = math.floor(most / digit) * digit
        problem = f"is too large for folds and cells of this size; give at most {rounded:g} mm"
        raise fault(f"thickness {thickness:g}", problem)
    offset = thickness / 2 * mitred_normals(sheet)
    count = len(sheet.nodes)
    edges, beside = sheet.rim()
    start, end = edges.T
    wall = np.stack([end, start, start + count, end + count], axis=-1)
    # Beginning at the same corner, a face has the same diagonal on both sides.
    below = np.roll(sheet.faces[:, ::-1], 1, axis=1) + count
    return SurfaceMesh(
        np.concatenate([sheet.nodes + offset, sheet.nodes - offset]),
        np.concatenate([sheet.faces, below, wall]),
        {name: np.concatenate([values, values]) for name, values in sheet.node_fields.items()},
        {
            name: np.concatenate([values, values, values[beside]])
            for name, values in sheet.face_fields.items()
        },
    )


def mitred_normals(sheet: SurfaceMesh) -> Float[np.ndarray, "node 3"]:
    """How far nodes move where the faces around them move by 1 along their normals [1].

    Along the mean of the normals, as far as serves these faces best; across a fold between two
    planes that is exact, up to :data:`MITRE_LIMIT`.
    """
    corners = sheet.nodes[sheet.faces]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), LEAST)
    node, face = sheet.faces.ravel(), np.repeat(np.arange(len(normals)), 4)
    total = np.zeros_like(sheet.nodes)
    np.add.at(total, node, normals[face])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    direction = total / np.maximum(length, LEAST)
    cosine = (normals[face] * direction[node]).sum(axis=1)
    sums, squares = (np.bincount(node, cosine**power, len(total)) for power in (1, 2))
    reach = np.clip(sums / np.maximum(squares, LEAST), 0, MITRE_LIMIT)
    return reach[:, None] * direction


def largest_thickness(sheet: SurfaceMesh) -> float:
    """Thickness at which a face of a side turns over, or that is the width of the sheet [mm].

    The area of a triangle whose corners move by s along their offsets, counted along its own
    normal, is a + b s + c s².
    """
    triangles = sheet.triangulated().faces
    points, offsets = sheet.nodes[triangles], mitred_normals(sheet)[triangles]
    side, other = (points[:, k] - points[:, 0] for k in (1, 2))
    turn, other_turn = (offsets[:, k] - offsets[:, 0] for k in (1, 2))
    normal = np.cross(side, other)
    changes = (
        normal,
        np.cross(turn, other) + np.cross(side, other_turn),
        np.cross(turn, other_turn),
    )
    area, linear, square = ((normal * change).sum(axis=1) for change in changes)
    turned = min(
        _smallest_positive_root(area, sign * linear, square).min(initial=np.inf) for sign in (1, -1)
    )
    return float(min(2 * turned, np.sort(sheet.size)[1]))


def _smallest_positive_root(
    constant: np.ndarray, linear: np.ndarray, square: np.ndarray
) -> Float[np.ndarray, " face"]:
    """Smallest s > 0 at which constant + linear s + square s² = 0; infinite if there is none.

    The constant is above 0; at 0, of a triangle without area, there is none.
    """
    root = np.sqrt(np.maximum(linear**2 - 4 * constant * square, 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # In this form no digits cancel, and a square of 0 is no exception.
        found = np.stack([2 * constant / (root - linear), 2 * constant / (-root - linear)])
    real = (linear**2 >= 4 * constant * square) & (found > 0)
    return np.where(real, found, np.inf).min(axis=0)
