"""The surface of a fabric at strains, with fields named with their unit or meaning."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from knitlab.cubes.case_file import configurations
from knitlab.export.meshes.surface import SurfaceMesh, grid_surface
from knitlab.io.errors import invalid

if TYPE_CHECKING:  # what they are in imports JAX
    from knitlab.model.pattern import Knit
    from knitlab.solvers.case import Case

MAX_FACES = 1_000_000  # grid cells of a mesh
KNITS: tuple["Knit", ...] = ("rib", "garter", "plain")
HEIGHT = "height [mm]"
FOLD_ANGLE = "fold_angle [rad]"
APPLIED_STRAIN = "applied_strain [1]"
KNIT = f"knit ({', '.join(f'{code} {knit}' for code, knit in enumerate(KNITS))})"
PATCH = "patch"
ELECTRODE = "electrode (0 none, 1 A, 2 B)"
PLATED = "plated [1]"
STRETCHES = {"stretch_weft [1]": 1, "stretch_warp [1]": 0}
"""Fields of the stretch of grid cells, and the axis of the grid that they are along."""
UNIT_CELL_STRAINS = ("strain_xx", "strain_yy")


def fabric_meshes(
    case_file: xr.Dataset, strains: Sequence[int], repeats: tuple[int, int] = (1, 1)
) -> list[SurfaceMesh]:
    """The surface of a fabric at reached strains; periodic fabric is repeated along (y, x)."""
    from knitlab.cubes.recorded_case import recorded_case

    case = recorded_case(case_file)
    given = f"repeats {' '.join(map(str, repeats))}"
    if len(repeats) != 2 or any(int(count) != count or count < 1 for count in repeats):
        raise invalid(given, "must be two whole numbers of 1 or more, along y and along x")
    if tuple(repeats) != (1, 1) and not is_periodic(case_file):
        raise invalid(given, "applies to periodic fabric only; for a sample with edges, give 1 1")
    faces = math.prod(repeats) * case_file.sizes["node_y"] * case_file.sizes["node_x"]
    if faces > MAX_FACES:
        raise invalid(given, f"makes {faces:,} cells, above {MAX_FACES:,}; take fewer repeats")
    shown = case_file.isel(applied_strain=list(strains))
    (relaxed,) = closed_nodes(case_file.isel(applied_strain=[0]), repeats)
    folds = _fold_angles(case, shown, relaxed.shape[:2])
    fixed = _fixed_fields(case, repeats)
    ordered = shown.transpose("applied_strain", "cell_y", "cell_x", ...)
    meshes = []
    for number, nodes in enumerate(closed_nodes(shown, repeats)):
        strain = np.full(nodes.shape[:2], float(shown["applied_strain"][number]))
        of_nodes = {HEIGHT: nodes[..., 2], FOLD_ANGLE: folds[number], APPLIED_STRAIN: strain}
        of_cells = dict(fixed)
        for name, axis in STRETCHES.items():
            of_cells[name] = _side_lengths(nodes, axis) / _side_lengths(relaxed, axis) - 1
        for name in UNIT_CELL_STRAINS:
            values = on_grid_cells(case, ordered[name].values[number])
            of_cells[f"{name} [1]"] = np.tile(values, repeats)
        has_fabric = None if case.spans is None else case.mesh_shape.has_fabric
        meshes.append(grid_surface(nodes, of_nodes, of_cells, has_fabric))
    return meshes


def on_grid_cells(
    case: "Case", values: Float[np.ndarray, "*states cell_y cell_x"]
) -> Float[np.ndarray, "*states grid_y grid_x"]:
    """The value of its unit cell for every grid cell; NaN beyond the last whole one."""
    rows, columns = (np.diff(lines) for lines in (case.cell_grid.rows, case.cell_grid.columns))
    known = values.repeat(rows, axis=-2).repeat(columns, axis=-1)
    beyond = np.subtract(case.sample.grid, known.shape[-2:]).tolist()
    return np.pad(
        known, [(0, 0)] * (values.ndim - 2) + [(0, more) for more in beyond], constant_values=np.nan
    )


def is_periodic(case_file: xr.Dataset) -> bool:
    """Whether the fabric of a case has no edges."""
    return "length_x" in case_file


def closed_nodes(
    case_file: xr.Dataset, repeats: tuple[int, int] = (1, 1)
) -> Float[np.ndarray, "strain node_y node_x 3"]:
    """Nodes at every strain [mm]; periodic fabric is repeated along (y, x) without seams."""
    from knitlab.model.cell_grid import nodes_at
    from knitlab.model.network import MeshShape

    periodic = is_periodic(case_file)
    cells_y, cells_x = (case_file.sizes[dim] - (not periodic) for dim in ("node_y", "node_x"))
    rows = np.arange(repeats[0] * cells_y + 1)
    columns = np.arange(repeats[1] * cells_x + 1)
    shape = MeshShape(cells_y, cells_x, periodic)
    return np.asarray(nodes_at(shape, configurations(case_file), rows, columns))


def _fixed_fields(case: "Case", repeats: tuple[int, int]) -> dict[str, np.ndarray]:
    along_y, along_x = case.unit_cells
    pattern = replace(case, unit_cells=(repeats[0] * along_y, repeats[1] * along_x)).sample
    across = pattern.knit.shape[1]
    knit = np.argmax([pattern.knit_cells(knit) for knit in KNITS], axis=0)
    patch = pattern.patch_of_row[:, None] * across + pattern.patch_of_column
    # Every format knows integers of 32 bits.
    fields: dict[str, np.ndarray] = {KNIT: knit.astype(np.int32), PATCH: patch.astype(np.int32)}
    if case.capacitor is not None:
        from knitlab.model.electrodes import split_by_cells

        shape = case.mesh_shape
        of_sheet = np.zeros((2, shape.cells_y, shape.cells_x))  # covered fraction of its cells
        for of_electrode, strips in zip(of_sheet, case.electrodes.strips, strict=True):
            for piece in chain.from_iterable(map(split_by_cells, strips)):
                # Over a seam a strip goes on at the other end.
                row = math.floor(piece.bottom)
                column = math.floor(piece.left)
                of_electrode[row % shape.cells_y, column % shape.cells_x] += piece.area
        covered = np.tile(of_sheet, (1, *repeats))
        plated = covered.sum(axis=0)
        fields[ELECTRODE] = np.where(plated > 0, 1 + np.argmax(covered, axis=0), 0).astype(np.int32)
        fields[PLATED] = plated
    return fields


def _side_lengths(
    nodes: Float[np.ndarray, "node_y node_x 3"], axis: int
) -> Float[np.ndarray, "cell_y cell_x"]:
    """Mean length of two opposite sides of every grid cell, along an axis of the grid [mm]."""
    length = np.linalg.norm(np.diff(nodes, axis=axis), axis=-1)
    return (np.delete(length, -1, 1 - axis) + np.delete(length, 0, 1 - axis)) / 2


def _fold_angles(
    case: "Case", case_file: xr.Dataset, closed: tuple[int, ...]
) -> Float[np.ndarray, "strain node_y node_x"]:
    """Mean fold angle of the fold lines that meet at a node, a mountain positive, else 0 [rad]."""
    from knitlab.model.energy import fold_angles

    layout = case.layout
    states = configurations(case_file)
    net = layout.net
    shape = layout.net.shape
    fabric = layout.fabric(case.stripe_pair)
    # State by state, one compiled program serves any number of them.
    angles = np.stack(
        [fold_angles(net, fabric, states[k]) for k in range(case_file.sizes["applied_strain"])]
    )
    total = np.zeros((len(angles), shape.nodes_y, shape.nodes_x))
    edges: Int[np.ndarray, "node_y node_x"] = np.zeros((shape.nodes_y, shape.nodes_x), int)
    folded = layout.fold_sense != 0
    for wale, (up, right) in ((True, (1, 0)), (False, (0, 1))):
        # A hinge turns about the left or the lower side of its cell.
        kind = np.flatnonzero(folded & (net.wale == wale))
        row, column = net.hinge_cells[kind].T
        for end in (0, 1):
            # No two hinges of a kind begin, or end, at one node.
            at = (row + end * up) % shape.nodes_y, (column + end * right) % shape.nodes_x
            total[:, *at] += angles[:, kind]
            edges[at] += 1
    rows, columns = (np.arange(many) % few for many, few in zip(closed, edges.shape, strict=True))
    return (total / np.maximum(edges, 1))[:, rows[:, None], columns]
