"""Formats of mesh files: which library writes each, and what it takes of a mesh."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.io.atomic_write import atomic_write
from knitlab.meshes.colours import linear, node_colours
from knitlab.meshes.surface import SurfaceMesh

METRES_OF_Z_UP = np.array(
    [[1e-3, 0, 0, 0], [0, 0, 1e-3, 0], [0, -1e-3, 0, 0], [0, 0, 0, 1]], dtype=float
)
"""Transform of positions in mm with z upwards to those of glTF, in m with y upwards."""


@dataclass(frozen=True)
class MeshFormat:
    """A format of mesh files.

    Attributes:
        write: writes a mesh into a file.
        quads: whether it can hold quads; otherwise they are divided.
    """

    write: Callable[[SurfaceMesh, Path], None]
    quads: bool


def _write_vtu(mesh: SurfaceMesh, path: Path) -> None:
    fields = {name: [values] for name, values in mesh.face_fields.items()}
    _meshio(mesh, dict(mesh.node_fields), fields).write(path, "vtu")


def _write_obj(mesh: SurfaceMesh, path: Path) -> None:
    _meshio(mesh).write(path, "obj")


def _write_ply(mesh: SurfaceMesh, path: Path) -> None:
    colours = dict(zip(("red", "green", "blue"), node_colours(mesh).T, strict=True))
    fields = {_word(name): values for name, values in mesh.node_fields.items()}
    _meshio(mesh, colours | fields).write(path, "ply")


def _write_stl(mesh: SurfaceMesh, path: Path) -> None:
    _trimesh(mesh).export(path, "stl")


def _write_glb(mesh: SurfaceMesh, path: Path) -> None:
    import trimesh

    # A material of two sides: of a sheet the back is seen too.
    material = trimesh.visual.material.PBRMaterial(
        name="fabric", doubleSided=True, metallicFactor=0.0, roughnessFactor=1.0
    )
    visual = trimesh.visual.TextureVisuals(material=material)
    light = np.rint(255 * linear(node_colours(mesh))).astype(np.uint8)
    opaque = np.full((len(light), 1), 255, np.uint8)
    visual.vertex_attributes["color"] = np.hstack([light, opaque])
    scene = trimesh.Scene()
    scene.add_geometry(
        _trimesh(mesh, visual), geom_name="fabric", node_name="fabric", transform=METRES_OF_Z_UP
    )
    scene.export(path, "glb")


FORMATS = {
    ".vtu": MeshFormat(_write_vtu, quads=True),
    ".obj": MeshFormat(_write_obj, quads=True),
    ".ply": MeshFormat(_write_ply, quads=True),
    ".stl": MeshFormat(_write_stl, quads=False),
    ".glb": MeshFormat(_write_glb, quads=False),
}
"""By the suffix of a file."""


def write_mesh(mesh: SurfaceMesh, path: Path) -> None:
    """Write a mesh into a file, atomically.

    Args:
        mesh: the mesh.
        path: the file, with a suffix of :data:`FORMATS`.

    Raises:
        CannotWrite: if it cannot be written.
    """
    with atomic_write(path) as temporary:
        FORMATS[path.suffix.lower()].write(mesh, temporary)


def _meshio(
    mesh: SurfaceMesh,
    node_fields: dict[str, np.ndarray] | None = None,
    face_fields: dict[str, list[np.ndarray]] | None = None,
) -> Any:
    import meshio

    kind = "quad" if mesh.faces.shape[1] == 4 else "triangle"
    faces = mesh.faces.astype(np.int32)
    return meshio.Mesh(mesh.nodes, [(kind, faces)], node_fields, face_fields)


def _trimesh(mesh: SurfaceMesh, visual: Any = None) -> Any:
    import trimesh

    # Unprocessed, it keeps the numbers of the nodes.
    faces = mesh.triangulated().faces
    return trimesh.Trimesh(mesh.nodes, faces, visual=visual, process=False)


def _word(name: str) -> str:
    """A name without brackets and spaces: ``height_mm`` for ``height [mm]``."""
    return re.sub(r"\W+", "_", name.removesuffix(" [1]")).strip("_")
