"""Files of meshes, read back by trimesh, by VTK, and from their bytes."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from knitlab.export.meshes.fabric import ELECTRODE, KNIT, fabric_meshes
from knitlab.export.meshes.formats import (
    ELECTRODE_COLOURS,
    FORMATS,
    KNIT_COLOURS,
    Shapes,
    linear,
    node_colours,
)
from knitlab.export.meshes.surface import solid_of
from knitlab.io.errors import CannotWrite
from tests.export.meshes.synthetic import kept_file, vtu_arrays, write_meshes


@pytest.fixture(scope="module")
def sheet():
    return fabric_meshes(kept_file(), [5], (1, 2))[0]


@pytest.fixture(params=["sheet", "solid", "triangles"])
def mesh(request, sheet):
    if request.param == "sheet":
        return sheet
    solid = solid_of(sheet, 0.1)
    return solid if request.param == "solid" else solid.triangulated()


@pytest.fixture
def written(mesh, tmp_path):
    def write(suffix):
        path = tmp_path / f"shape{suffix}"
        write_meshes(Shapes([mesh], [0.0]), path)
        assert [each.name for each in tmp_path.iterdir()] == [path.name]
        return path

    return write


def loaded(path):
    """A file as trimesh reads it; it divides quads as knitlab does."""
    return trimesh.load(path, process=False, force="mesh")


def test_a_vtu_file_holds_mesh_and_fields(mesh, written):
    read = vtu_arrays(written(".vtu"))
    corners = mesh.faces.shape[1]
    assert (read["Points", "Points"] == mesh.nodes).all()
    assert (read["Cells", "connectivity"].reshape(-1, corners) == mesh.faces).all()
    assert (read["Cells", "offsets"] == corners * np.arange(1, len(mesh.faces) + 1)).all()
    assert (read["Cells", "types"] == {3: 5, 4: 9}[corners]).all()  # VTK_TRIANGLE, VTK_QUAD
    fields = {("PointData", name): values for name, values in mesh.node_fields.items()}
    fields |= {("CellData", name): values for name, values in mesh.face_fields.items()}
    for place, values in fields.items():
        np.testing.assert_array_equal(read[place], values)
    assert len(read) == 4 + len(fields)


@pytest.mark.nightly
@pytest.mark.slow
def test_vtk_reads_a_vtu_file(mesh, written):
    vtk = pytest.importorskip("vtk", reason="vtk is not installed; .ci/nightly installs it")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(written(".vtu")))
    reader.Update()
    assert reader.GetErrorCode() == 0
    grid = reader.GetOutput()
    assert (vtk_to_numpy(grid.GetPoints().GetData()) == mesh.nodes).all()
    corners = mesh.faces.shape[1]
    connectivity = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    assert (connectivity.reshape(-1, corners) == mesh.faces).all()
    assert grid.GetCell(0).GetClassName() == {3: "vtkTriangle", 4: "vtkQuad"}[corners]
    groups = ((grid.GetPointData(), mesh.node_fields), (grid.GetCellData(), mesh.face_fields))
    for held, fields in groups:
        assert held.GetNumberOfArrays() == len(fields)
        for name, values in fields.items():
            np.testing.assert_array_equal(vtk_to_numpy(held.GetArray(name)), values)


def test_an_obj_file_holds_quads_or_triangles(mesh, written):
    path = written(".obj")
    faces = [line.split()[1:] for line in path.read_text().splitlines() if line[0] == "f"]
    assert (np.array(faces, int) - 1 == mesh.faces).all()
    read = loaded(path)
    assert (read.vertices == mesh.nodes).all()
    assert by_corners(read.faces) == by_corners(mesh.triangulated().faces)


def by_corners(triangles):
    """Triangles in any order, each from its lowest corner on, in its own sense."""
    first = np.argmin(triangles, axis=1)[:, None]
    return sorted(np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1).tolist())


def test_a_ply_file_has_colours_and_the_fields_of_nodes(mesh, written):
    read = loaded(written(".ply"))
    np.testing.assert_allclose(read.vertices, mesh.nodes, rtol=1e-6)  # in single precision
    assert by_corners(read.faces) == by_corners(mesh.triangulated().faces)
    assert (read.visual.vertex_colors[:, :3] == node_colours(mesh)).all()
    values = read.metadata["_ply_raw"]["vertex"]["data"]
    names = ["height_mm", "fold_angle_rad", "applied_strain"]
    for name, expected in zip(names, mesh.node_fields.values(), strict=True):
        assert (values[name].ravel() == expected).all()


def test_an_stl_file_holds_every_triangle_outside_out(mesh, written):
    path = written(".stl")
    corners = mesh.nodes[mesh.triangulated().faces]
    np.testing.assert_allclose(loaded(path).triangles, corners, atol=1e-6)
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((outwards * loaded(path).face_normals).sum(axis=1) > 0).all()


def test_a_printed_solid_is_watertight_once_its_corners_are_joined(sheet, tmp_path):
    solid = solid_of(sheet, 0.1)
    write_meshes(Shapes([solid], [0.0]), tmp_path / "print.stl")
    body = trimesh.load(tmp_path / "print.stl")
    assert body.is_watertight
    assert body.is_winding_consistent
    assert len(body.vertices) == len(solid.nodes)
    assert body.euler_number == 2
    # Mitred folds keep the volume near that of the sheet; its cells are not quite planes.
    area = trimesh.Trimesh(sheet.nodes, sheet.triangulated().faces, process=False).area
    assert body.volume == pytest.approx(0.1 * area, rel=0.05)


def test_a_glb_file_is_in_metres_with_y_up(mesh, written):
    scene = trimesh.load_scene(written(".glb"))
    (body,) = scene.geometry.values()
    assert body.visual.material.doubleSided
    np.testing.assert_allclose(body.vertices, mesh.nodes, rtol=1e-6)
    assert (body.faces == mesh.triangulated().faces).all()
    transform, _ = scene.graph["fabric"]
    x, y, z = trimesh.transform_points(mesh.nodes, transform).T
    np.testing.assert_allclose(np.stack([x, -z, y], axis=1), mesh.nodes / 1000, atol=1e-12)
    assert np.linalg.det(transform[:3, :3]) > 0, "a mirror image"
    light = np.rint(255 * linear(node_colours(mesh)))
    assert (body.visual.vertex_attributes["color"][:, :3] == light).all()


def test_a_node_within_a_patch_has_its_colour_and_one_on_a_border_the_mean(sheet):
    colours = node_colours(sheet).reshape(17, 33, 3)
    rib, garter, _ = KNIT_COLOURS
    assert (colours[4, 4] == rib).all()
    assert (colours[4, 12] == garter).all()
    assert (colours[4, 8] == np.mean([rib, garter], axis=0).round()).all()


def test_electrodes_have_colours_of_their_own(sheet):
    plated = np.zeros_like(sheet.face_fields[KNIT]).reshape(16, 32)
    plated[:, 2:6], plated[:, 8:12] = 1, 2
    fields = {**sheet.face_fields, ELECTRODE: plated.ravel()}
    colours = node_colours(replace(sheet, face_fields=fields)).reshape(17, 33, 3)
    assert (colours[:, 3:6] == ELECTRODE_COLOURS[0]).all()
    assert (colours[:, 9:12] == ELECTRODE_COLOURS[1]).all()
    assert (colours[4, 1] == KNIT_COLOURS[0]).all()


def test_linear_light_is_that_of_the_standard():
    # IEC 61966-2-1: 0.5 of sRGB is 0.2140 of the light, and its dark end is a straight line.
    shades = np.array([[0, 255, 10]], np.uint8)
    np.testing.assert_allclose(linear(shades), [[0, 1, 10 / 255 / 12.92]])
    assert linear(np.full((1, 3), 128, np.uint8)) == pytest.approx(0.2158605, rel=1e-6)


def test_a_series_lists_a_file_for_every_strain(tmp_path):
    meshes = fabric_meshes(kept_file(), [0, 2])
    files = write_meshes(Shapes(meshes, [0.0, 0.06]), tmp_path / "pulled.pvd")
    names = [str(each.relative_to(tmp_path)) for each in files]
    assert names == ["pulled.pvd", "pulled/strain_0.vtu", "pulled/strain_0.06.vtu"]
    root = ElementTree.parse(files[0]).getroot()
    assert root.get("type") == "Collection"
    listed = {float(each.get("timestep")): each.get("file") for each in root.iter("DataSet")}
    assert list(listed) == [0.0, 0.06]
    for mesh, file in zip(meshes, listed.values(), strict=True):
        assert (vtu_arrays(tmp_path / file)["Points", "Points"] == mesh.nodes).all()
    assert len([*tmp_path.rglob("*")]) == 4, "something unfinished is left"


def test_a_series_that_is_written_again_leaves_no_mesh_of_the_earlier_one(sheet, tmp_path):
    write_meshes(Shapes([sheet] * 3, [0.0, 0.1, 0.2]), tmp_path / "pulled.pvd")
    (tmp_path / "pulled/notes.txt").write_text("mine")
    write_meshes(Shapes([sheet] * 2, [0.0, 0.15]), tmp_path / "pulled.pvd")
    left = {path.name for path in (tmp_path / "pulled").iterdir()}
    assert left == {"strain_0.vtu", "strain_0.15.vtu", "notes.txt"}


@pytest.mark.parametrize("suffix", [*FORMATS, ".VTU", ".STL"])
def test_a_file_that_cannot_be_written_leaves_nothing(sheet, tmp_path, suffix):
    (tmp_path / "taken").write_text("a file where a folder should be")
    with pytest.raises(CannotWrite, match="cannot be written"):
        write_meshes(Shapes([sheet], [0.0]), tmp_path / "taken" / f"shape{suffix}")
    write_meshes(Shapes([sheet], [0.0]), tmp_path / f"shape{suffix}")
    assert (tmp_path / f"shape{suffix}").stat().st_size > 100
