"""Formats of mesh files: which library writes each; those without fields of faces get colours."""

import base64
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float, UInt8

from knitlab.export.meshes.fabric import ELECTRODE, KNIT
from knitlab.export.meshes.surface import SurfaceMesh
from knitlab.io.atomic_write import atomic_write

KNIT_COLOURS = ((166, 206, 227), (240, 228, 66), (221, 221, 221))
"""Colours of rib, garter and plain knit, told apart without colour vision [sRGB]."""
ELECTRODE_COLOURS = ((213, 94, 0), (0, 114, 178))  # of electrodes A and B, likewise [sRGB]
METRES_OF_Z_UP = np.array([[1e-3, 0, 0, 0], [0, 0, 1e-3, 0], [0, -1e-3, 0, 0], [0, 0, 0, 1]])
"""Transform of positions in mm with z upwards to those of glTF, in m with y upwards."""

VTK_TRIANGLE = 5
VTK_QUAD = 9
VTK_TYPES = {"f": "Float", "i": "Int", "u": "UInt"}  # by the kind of a NumPy type


@dataclass(frozen=True)
class Shapes:
    """What a file is written of: the meshes of one fabric at applied strains."""

    meshes: Sequence[SurfaceMesh]
    strains: Sequence[float]
    unit: str = "mm"  # of the nodes

    @property
    def first(self) -> SurfaceMesh:
        """The only mesh of a format that holds one."""
        return self.meshes[0]


Writer = Callable[[Shapes, Path], None]


@dataclass(frozen=True)
class MeshFormat:
    """A file format of meshes, chosen by the suffix of the file."""

    write: Callable[[Shapes, Path], list[Path]]  # returns the files, that of the path first
    has_quads: bool = True
    is_series: bool = False  # whether one file holds a mesh for each strain


FORMATS: dict[str, MeshFormat] = {}  # every format by its suffix; the functions below add them


def mesh_format(suffix: str, **properties: Any) -> Callable[[Writer], Writer]:
    """Register a function that writes one file, which is then written atomically."""

    def register(write: Writer) -> Writer:
        def write_atomically(shapes: Shapes, path: Path) -> list[Path]:
            with atomic_write(path) as temporary:
                write(shapes, temporary)
            return [path]

        FORMATS[suffix] = MeshFormat(write_atomically, **properties)
        return write

    return register


def node_colours(mesh: SurfaceMesh) -> UInt8[np.ndarray, "node 3"]:
    """Mean colour of the faces around a node [sRGB], by their electrode or, without one, knit."""
    colours = np.array(KNIT_COLOURS, float)[mesh.face_fields[KNIT]]
    if ELECTRODE in mesh.face_fields:
        electrode = mesh.face_fields[ELECTRODE]
        colours[electrode > 0] = np.array(ELECTRODE_COLOURS, float)[electrode[electrode > 0] - 1]
    nodes = mesh.faces.ravel()
    around = np.repeat(colours, mesh.faces.shape[1], axis=0)
    total = np.stack([np.bincount(nodes, shade, len(mesh.nodes)) for shade in around.T], axis=1)
    return np.rint(total / np.bincount(nodes)[:, None]).astype(np.uint8)


def linear(colours: UInt8[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
    """Colours as light, from 0 to 1, in place of sRGB (IEC 61966-2-1)."""
    shade = colours / 255
    return np.where(shade <= 0.04045, shade / 12.92, ((shade + 0.055) / 1.055) ** 2.4)


@mesh_format(".vtu")
def _write_vtu(shapes: Shapes, path: Path) -> None:
    """An unstructured grid of VTK: arrays in base64, each after its size in bytes."""
    mesh = shapes.first
    corners = mesh.faces.shape[1]
    count = len(mesh.faces)
    root = ElementTree.Element("VTKFile", type="UnstructuredGrid", version="1.0")
    root.set("byte_order", "LittleEndian")
    root.set("header_type", "UInt64")
    grid = ElementTree.SubElement(root, "UnstructuredGrid")
    sizes = {"NumberOfPoints": str(len(mesh.nodes)), "NumberOfCells": str(count)}
    piece = ElementTree.SubElement(grid, "Piece", sizes)
    cell_type = VTK_QUAD if corners == 4 else VTK_TRIANGLE
    cells = {
        "connectivity": mesh.faces.astype(np.int64).ravel(),
        "offsets": np.arange(1, count + 1) * corners,
        "types": np.full(count, cell_type, np.uint8),
    }
    groups: dict[str, Mapping[str, np.ndarray]] = {
        "Points": {"Points": mesh.nodes},
        "Cells": cells,
        "PointData": mesh.node_fields,
        "CellData": mesh.face_fields,
    }
    for group, arrays in groups.items():
        parent = ElementTree.SubElement(piece, group)
        for name, values in arrays.items():
            array = ElementTree.SubElement(parent, "DataArray", Name=name, format="binary")
            array.set("type", VTK_TYPES[values.dtype.kind] + str(8 * values.itemsize))
            array.set("NumberOfComponents", str(values[0].size))
            content = values.astype(values.dtype.newbyteorder("<")).tobytes()
            size = len(content).to_bytes(8, "little")
            array.text = base64.b64encode(size + content).decode()
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


@mesh_format(".obj")
def _write_obj(shapes: Shapes, path: Path) -> None:
    mesh = shapes.first
    with path.open("w", encoding="utf-8", newline="\n") as file:
        np.savetxt(file, mesh.nodes, "v %.17g %.17g %.17g")
        np.savetxt(file, mesh.faces + 1, "f" + " %d" * mesh.faces.shape[1])


@mesh_format(".ply", has_quads=False)
def _write_ply(shapes: Shapes, path: Path) -> None:
    mesh = shapes.first
    solid = _trimesh(mesh)
    solid.visual.vertex_colors = node_colours(mesh)
    for name, values in mesh.node_fields.items():
        # Names have no brackets and spaces: height_mm for height [mm].
        name = re.sub(r"\W+", "_", name.removesuffix(" [1]")).strip("_")
        solid.vertex_attributes[name] = values
    solid.export(path, "ply")


@mesh_format(".stl", has_quads=False)
def _write_stl(shapes: Shapes, path: Path) -> None:
    _trimesh(shapes.first).export(path, "stl")


@mesh_format(".glb", has_quads=False)
def _write_glb(shapes: Shapes, path: Path) -> None:
    import trimesh

    # A material of two sides: of a sheet the back is seen too.
    look: dict[str, Any] = {"doubleSided": True, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    material = trimesh.visual.material.PBRMaterial(name="fabric", **look)
    visual = trimesh.visual.TextureVisuals(material=material)
    light = np.rint(255 * linear(node_colours(shapes.first))).astype(np.uint8)
    visual.vertex_attributes["color"] = np.insert(light, 3, 255, axis=1)  # opaque
    scene = trimesh.Scene()
    solid = _trimesh(shapes.first, visual)
    scene.add_geometry(solid, node_name="fabric", geom_name="fabric", transform=METRES_OF_Z_UP)
    scene.export(path, "glb")


def _write_series(shapes: Shapes, path: Path) -> list[Path]:
    """A ``.vtu`` for each strain in a folder, and a ``.pvd`` with their strains as times."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    files = []
    for mesh, strain in zip(shapes.meshes, shapes.strains, strict=True):
        time = f"{strain:.9g}"
        file = path.with_suffix("") / f"strain_{time}.vtu"
        files += FORMATS[".vtu"].write(Shapes([mesh], [strain]), file)
        name = file.relative_to(path.parent).as_posix()
        ElementTree.SubElement(collection, "DataSet", timestep=time, part="0", file=name)
    ElementTree.indent(root)
    with atomic_write(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    for stale in {*path.with_suffix("").glob("strain_*.vtu")} - {*files}:
        stale.unlink()
    return [path, *files]


FORMATS[".pvd"] = MeshFormat(_write_series, is_series=True)


@mesh_format(".fold", is_series=True)
def _write_fold(shapes: Shapes, path: Path) -> None:
    """A FOLD file, version 1.2, with a frame for each strain; all edges are creases."""
    edges, faces = shapes.first.edges()
    frames: list[dict[str, Any]] = []
    for mesh, strain in zip(shapes.meshes, shapes.strains, strict=True):
        angles = mesh.fold_angles().round(3) + 0.0  # without -0
        kinds = np.array(["F", "V", "M"])[np.sign(angles).astype(int)]
        frames.append(
            {
                "frame_title": f"applied strain {strain:.9g}",
                "vertices_coords": mesh.nodes.round(6).tolist(),
                "edges_assignment": np.where(faces[:, 1] < 0, "B", kinds).tolist(),
                "edges_foldAngle": angles.tolist(),
            }
        )
    model = {
        "file_spec": 1.2,
        "file_creator": "knitlab",
        "file_classes": ["singleModel", "animation"],
        "frame_classes": ["foldedForm"],
        "frame_attributes": ["manifold", "orientable"],
        "frame_unit": shapes.unit,
        "faces_vertices": shapes.first.faces.tolist(),
        "edges_vertices": edges.tolist(),
        **frames[0],
        "file_frames": [{"frame_parent": 0, "frame_inherit": True} | each for each in frames[1:]],
    }
    path.write_text(json.dumps(model), encoding="utf-8")


def _trimesh(mesh: SurfaceMesh, visual: Any = None) -> Any:
    import trimesh

    # Unprocessed, it keeps the numbers of the nodes.
    return trimesh.Trimesh(mesh.nodes, mesh.triangulated().faces, visual=visual, process=False)
