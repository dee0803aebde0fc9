"""Series of meshes over the applied strain, as ParaView reads them."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from knitlab.io.atomic_write import atomic_write
from knitlab.meshes.formats import write_mesh
from knitlab.meshes.surface import SurfaceMesh

SERIES = ".pvd"


def write_series(meshes: Sequence[SurfaceMesh], strains: Sequence[float], path: Path) -> list[Path]:
    """Write a mesh for each strain into a folder, and the collection that lists them.

    The folder lies beside the collection and has its name. Every file is written atomically, the
    collection last, so that it never lists a file that is not there.

    Args:
        meshes: the meshes.
        strains: the applied strain of each, ParaView's time [1].
        path: the collection, a ``.pvd`` file.

    Returns:
        The collection, then the meshes.

    Raises:
        CannotWrite: if a file cannot be written.
    """
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    files = []
    for mesh, strain in zip(meshes, strains, strict=True):
        time = f"{strain:.9g}"
        file = path.with_suffix("") / f"strain_{time}.vtu"
        write_mesh(mesh, file)
        files.append(file)
        place = file.relative_to(path.parent).as_posix()
        ElementTree.SubElement(collection, "DataSet", timestep=time, part="0", file=place)
    ElementTree.indent(root)
    with atomic_write(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    return [path, *files]
