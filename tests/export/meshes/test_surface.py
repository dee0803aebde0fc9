"""Surfaces of sheets: oriented, of one piece, with a rim that is that of the sheet."""

import numpy as np
import trimesh
from hypothesis import given

from knitlab.export.meshes.surface import grid_surface
from tests.export.meshes.synthetic import bumpy_sheets, zigzag


def as_trimesh(mesh):
    return trimesh.Trimesh(mesh.nodes, mesh.triangulated().faces, process=False)


@given(bumpy_sheets())
def test_a_sheet_is_oriented_and_its_only_rim_is_its_own(nodes):
    mesh = grid_surface(nodes)
    surface = as_trimesh(mesh)
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    edges, faces = mesh.rim()
    assert surface.euler_number == 1  # a disc
    assert surface.is_winding_consistent
    assert (surface.face_normals[:, 2] > 0).all()
    assert len(mesh.faces) == rows * columns
    assert len(edges) == len(faces) == 2 * (rows + columns)
    # The rim is one loop, anticlockwise: each of its edges begins where another ends.
    assert sorted(edges[:, 0].tolist()) == sorted(edges[:, 1].tolist())
    x, y = mesh.nodes[edges][..., :2].transpose(2, 1, 0)
    assert (x[0] * y[1] - x[1] * y[0]).sum() > 0


def test_fields_follow_their_faces_when_these_are_divided():
    mesh = grid_surface(
        zigzag((2, 3), 0.4), {"node": np.arange(12.0)}, {"face": [[0, 1, 2], [3, 4, 5]]}
    )
    divided = mesh.triangulated()
    assert divided.node_fields["node"].tolist() == list(range(12))
    assert divided.face_fields["face"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    assert divided.triangulated() is divided
    # Face 4 lies in the second row and the second column.
    assert mesh.faces[mesh.face_fields["face"] == 4].tolist() == [[5, 6, 10, 9]]
