"""Export of shapes as meshes for other programs."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.api.cubes import Cube
from knitlab.cube.cube_file import cube_path, is_case, open_cube
from knitlab.cube.selection import refuse_others
from knitlab.io.errors import fault
from knitlab.meshes.chosen_case import STRAIN, chosen_case, chosen_strains
from knitlab.meshes.fabric import fabric_meshes
from knitlab.meshes.formats import FORMATS, SERIES, TRIANGLES, write_mesh, write_series
from knitlab.meshes.solid import solid_of
from knitlab.meshes.surface import SurfaceMesh


@dataclass(frozen=True, eq=False)
class Exported:
    """What was exported.

    Attributes:
        files: the files, the one that was asked for first.
        applied_strain: the strains of the meshes [1].
        meshes: the mesh at each, with ``nodes`` in mm, ``faces``, ``node_fields`` and
            ``face_fields``.
        self_intersections: at each, pairs of grid cells of a sample, or of one repeat, that pass
            through each other [1].
    """

    files: tuple[Path, ...]
    applied_strain: tuple[float, ...]
    meshes: tuple[SurfaceMesh, ...]
    self_intersections: tuple[int, ...]

    def __repr__(self) -> str:
        nodes = sum(len(mesh.nodes) for mesh in self.meshes)
        return f"<Exported {self.files[0]}: {len(self.meshes)} meshes, {nodes} nodes>"


def export(
    shapes: Cube,
    output: str | Path,
    selections: Mapping[str, Any] = {},
    *,
    repeats: tuple[int, int] = (1, 1),
    triangles: bool = False,
    thickness: float | None = None,
    **named: Any,
) -> Exported:
    """Write the shape of one design as a mesh that other programs read.

    The mesh is the sheet of grid cells in mm, x along the courses and y along the wales, with the
    technical face up. Faces that meet share their nodes, over the seams of repeats too; the only
    rim is that of the sheet.

    Args:
        shapes: dataset of :func:`knitlab.simulate`, or a cube with its case files beside it.
        output: file to write. Its suffix sets the format: ``.vtu``, ``.ply``, ``.obj``, ``.stl`` or
            ``.glb``; ``.pvd`` is a series over the applied strain, with a ``.vtu`` for each in a
            folder beside it.
        selections: a value for each coordinate, until one design is left. ``applied_strain`` is 0
            if it is left out, of a series every strain that was reached.
        repeats: how often periodic fabric is repeated along the warp (y) and the weft (x).
        triangles: whether grid cells are divided into triangles also where the format has quads.
        thickness: of a closed solid, half of it on either side of the sheet [mm]; without it the
            mesh is the open sheet.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        The files and their meshes.

    Raises:
        BadInput: if the suffix is unknown, if not exactly one design is left, if it has no shape at
            a strain, or if repeats or thickness do not fit it.

    Example:
        >>> import knitlab as kl
        >>> exported = kl.export(
        ...     "results/reference/periodic",
        ...     folder / "shape.vtu",
        ...     n_stripe=4,
        ...     n_subunit=16,
        ...     applied_strain=0.15,
        ... )
        >>> len(exported.meshes[0].faces)
        256
    """
    output, selections = Path(output), {**selections, **named}
    suffix = output.suffix.lower()
    if suffix not in (*FORMATS, SERIES):
        known = ", ".join((*FORMATS, SERIES))
        raise fault(f"output {output}", f"has no suffix of a mesh; give one of {known}")
    case_file = _case_file(shapes, selections)
    places = chosen_strains(case_file, selections, several=suffix == SERIES)
    meshes = fabric_meshes(case_file, places, repeats)
    if thickness is not None:
        meshes = [solid_of(mesh, thickness) for mesh in meshes]
    if triangles or suffix in TRIANGLES:
        meshes = [mesh.triangulated() for mesh in meshes]
    strains = tuple(case_file[STRAIN].values[places].tolist())
    files = [output]
    if suffix == SERIES:
        files = write_series(meshes, strains, output)
    else:
        write_mesh(meshes[0], output)
    crossing = case_file["self_intersections"].values[places].astype(int).tolist()
    return Exported(tuple(files), strains, tuple(meshes), tuple(crossing))


def _case_file(shapes: Cube, selections: Mapping[str, Any]) -> xr.Dataset:
    """The contents of the case file of one design."""
    if isinstance(shapes, str | Path):
        return chosen_case(open_cube(shapes), cube_path(shapes).parent, selections)
    if "status" not in shapes:
        raise fault("shapes", "is not a cube or a test; give one of knitlab.run or simulate")
    if is_case(shapes):
        refuse_others(selections, [STRAIN], f"is of a cube; of a test, select {STRAIN} alone")
        return shapes
    if (source := shapes.encoding.get("source")) is None:
        problem = (
            "is a cube that was not opened from a file, beside which shapes lie; give its path"
        )
        raise fault("shapes", problem)
    return chosen_case(shapes, Path(source).parent, selections)
