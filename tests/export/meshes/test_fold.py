"""FOLD files: the rules of their specification, and angles against other ways to compute them."""

import json

import numpy as np
import pytest
import trimesh

import knitlab as kl
from knitlab.export.meshes.fabric import fabric_meshes
from knitlab.export.meshes.formats import Shapes
from knitlab.export.meshes.surface import grid_surface, solid_of
from tests.export.meshes.synthetic import PREVIEW, kept_file, write_meshes, zigzag

ONE = {"n_stripe": 4, "n_subunit": 16}
PROPERTIES = {
    "file": {"spec", "creator", "classes", "frames"},
    "frame": {"title", "classes", "attributes", "unit", "parent", "inherit"},
    "vertices": {"coords"},
    "edges": {"vertices", "assignment", "foldAngle"},
    "faces": {"vertices"},
}
"""Those of version 1.2 that are used."""


def frames_of(path):
    """The frames of a file, each with what it inherits, after a check of the specification."""
    first = json.loads(path.read_text())
    assert first["file_spec"] == 1.2
    frames = [first]
    for later in first["file_frames"]:
        assert not [name for name in later if name.startswith("file_")]
        assert later["frame_inherit"] is True
        frames.append(frames[later["frame_parent"]] | later)
    for frame in frames:
        for name in frame:
            about, _, what = name.partition("_")
            assert what in PROPERTIES[about]
        check(frame)
    return frames


def check(frame):
    assert frame["frame_unit"] in {"unit", "in", "pt", "m", "cm", "mm", "um", "nm"}
    nodes = np.array(frame["vertices_coords"], float)
    faces, edges = frame["faces_vertices"], frame["edges_vertices"]
    assert nodes.shape[1] == 3
    assert np.isfinite(nodes).all()
    assert {node for face in faces for node in face} == set(range(len(nodes)))
    beside = {frozenset(edge): [] for edge in edges}
    assert len(beside) == len(edges)
    for number, face in enumerate(faces):
        for side in zip(face, [*face[1:], face[0]], strict=True):
            beside[frozenset(side)].append((side, number))
    assert len(frame["edges_assignment"]) == len(frame["edges_foldAngle"]) == len(edges)
    signs = {"V": 1, "M": -1, "F": 0, "B": 0}
    for edge, kind, angle in zip(
        edges, frame["edges_assignment"], frame["edges_foldAngle"], strict=True
    ):
        sides = beside[frozenset(edge)]
        assert len(sides) == (1 if kind == "B" else 2), "manifold"
        assert len({side for side, _ in sides}) == len(sides), "orientable"
        assert -180 <= angle <= 180
        assert np.sign(angle) == signs[kind]


@pytest.mark.parametrize("half", [0.3, 1.2, -0.3])
def test_ridges_of_a_zigzag_are_mountains_and_grooves_valleys(tmp_path, half):
    write_meshes(Shapes([grid_surface(zigzag((3, 6), half))], [0.1], "mm"), tmp_path / "a.fold")
    (frame,) = frames_of(tmp_path / "a.fold")
    nodes = np.array(frame["vertices_coords"])
    for (start, end), angle in zip(frame["edges_vertices"], frame["edges_foldAngle"], strict=True):
        inside = 0 < nodes[start, 0] < nodes[:, 0].max()
        if nodes[start, 0] == nodes[end, 0] and inside:
            ridge = nodes[start, 2] == nodes[:, 2].max()
            expected = np.degrees(-2 * abs(half) if ridge else 2 * abs(half))
            assert angle == pytest.approx(expected, abs=1e-3)
        else:
            assert angle == 0


def test_frames_are_the_shapes_along_the_strain(tmp_path):
    exported = kl.export(PREVIEW, tmp_path / "a.fold", **ONE, applied_strain=[0, 0.15, 0.3])
    frames = frames_of(tmp_path / "a.fold")
    assert exported.files == (tmp_path / "a.fold",)
    titles = [f"applied strain {strain}" for strain in ("0", "0.15", "0.3")]
    assert [frame["frame_title"] for frame in frames] == titles
    for frame, mesh in zip(frames, exported.meshes, strict=True):
        np.testing.assert_allclose(frame["vertices_coords"], mesh.nodes, atol=1e-6)
        assert frame["frame_unit"] == "mm"
    assert len(frames_of(kl.export(PREVIEW, tmp_path / "b.fold", **ONE).files[0])) == kept_file(
    ).sizes["applied_strain"]  # fmt: skip


def test_a_solid_of_triangles_has_the_angles_that_trimesh_finds(tmp_path):
    (sheet,) = fabric_meshes(kept_file(), [5])
    solid = solid_of(sheet, 0.05).triangulated()
    write_meshes(Shapes([solid], [0.0], "mm"), tmp_path / "a.fold")
    (frame,) = frames_of(tmp_path / "a.fold")
    assert "B" not in frame["edges_assignment"]
    body = trimesh.Trimesh(solid.nodes, solid.faces, process=False)
    signed = np.degrees(body.face_adjacency_angles)
    signed *= np.where(body.face_adjacency_convex, -1, 1)
    found = {frozenset(edge): angle for edge, angle in zip(
        body.face_adjacency_edges.tolist(), signed, strict=True)}  # fmt: skip
    expected = [found[edge] for edge in map(frozenset, frame["edges_vertices"])]
    assert frame["edges_foldAngle"] == pytest.approx(expected, abs=0.01)
