"""The surface of a fabric at strains of its test, with all of its fields."""

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from pydantic import ValidationError

from knitlab.io.errors import fault
from knitlab.meshes.fields import (
    APPLIED_STRAIN,
    ELECTRODE,
    FOLD_ANGLE,
    HEIGHT,
    KNIT,
    PATCH,
    PLATED,
    STRETCHES,
    UNIT_CELL_STRAINS,
    fold_angle_at_nodes,
    knit_of_cells,
    patch_of_cells,
    plated_part,
    stretch_of_cells,
    unit_cell_strain,
)
from knitlab.meshes.sheet import closed_nodes, is_periodic
from knitlab.meshes.surface import SurfaceMesh, grid_surface

if TYPE_CHECKING:
    from knitlab.simulation.case import Case

MOST_FACES = 1_000_000
"""Largest number of grid cells of a mesh."""


def fabric_meshes(
    case_file: xr.Dataset, places: Sequence[int], repeats: tuple[int, int] = (1, 1)
) -> list[SurfaceMesh]:
    """The surface of a fabric at several strains, quad by quad, with its fields.

    Args:
        case_file: contents of a case file, with node positions.
        places: indices of the strains, all of them reached.
        repeats: how often periodic fabric is repeated along (y, x).

    Raises:
        BadInput: if the repeats do not fit the fabric, or another version recorded the case.
    """
    case = _recorded_case(case_file)
    _check_repeats(case_file, repeats)
    shown = case_file.isel(applied_strain=list(places))
    (relaxed,) = closed_nodes(case_file.isel(applied_strain=[0]), repeats)
    folds = _closed(fold_angle_at_nodes(case, shown), relaxed.shape[:2])
    fixed = _fixed_fields(case, repeats)
    strains = {
        f"{name} [1]": np.tile(unit_cell_strain(case, shown, name), (1, *repeats))
        for name in UNIT_CELL_STRAINS
    }
    meshes = []
    for number, nodes in enumerate(closed_nodes(shown, repeats)):
        strain = np.full(nodes.shape[:2], float(shown["applied_strain"][number]))
        stretches = {
            name: stretch_of_cells(relaxed, nodes, axis) for name, axis in STRETCHES.items()
        }
        of_unit_cells = {name: values[number] for name, values in strains.items()}
        meshes.append(
            grid_surface(
                nodes,
                {HEIGHT: nodes[..., 2], FOLD_ANGLE: folds[number], APPLIED_STRAIN: strain},
                {**fixed, **stretches, **of_unit_cells},
            )
        )
    return meshes


def _recorded_case(case_file: xr.Dataset) -> "Case":
    from knitlab.simulation.case import case_of

    try:
        return case_of(json.loads(case_file.attrs["parameters"]))
    except (ValidationError, KeyError, TypeError) as error:
        title = case_file.attrs.get("title", "test")
        problem = "was recorded by another version of knitlab; run it again"
        raise fault(str(title), problem) from error


def _check_repeats(case_file: xr.Dataset, repeats: tuple[int, int]) -> None:
    given = f"repeats {' '.join(map(str, repeats))}"
    if len(repeats) != 2 or any(int(count) != count or count < 1 for count in repeats):
        raise fault(given, "is not 1 or more along y and along x; give two whole numbers")
    if tuple(repeats) != (1, 1) and not is_periodic(case_file):
        raise fault(given, "is of periodic fabric, and this sample has edges; give 1 1")
    faces = math.prod(repeats) * case_file.sizes["node_y"] * case_file.sizes["node_x"]
    if faces > MOST_FACES:
        raise fault(given, f"makes {faces:,} grid cells, above {MOST_FACES:,}; repeat it less")


def _fixed_fields(case: "Case", repeats: tuple[int, int]) -> dict[str, np.ndarray]:
    """Fields that are the same at every strain."""
    from knitlab.fabric.pattern import recorded_pattern

    along_y, along_x = case.unit_cells
    pattern = recorded_pattern(case.record, (repeats[0] * along_y, repeats[1] * along_x))
    found = {KNIT: knit_of_cells(pattern), PATCH: patch_of_cells(pattern)}
    if case.capacitor is not None:
        parts = np.tile(plated_part(case), (1, *repeats))
        plated = parts.sum(axis=0)
        found[ELECTRODE] = np.where(plated > 0, 1 + np.argmax(parts, axis=0), 0)
        found[PLATED] = plated
    return {name: _compact(values) for name, values in found.items()}


def _compact(values: np.ndarray) -> np.ndarray:
    """Integers in the 32 bits that every format knows."""
    return values.astype(np.int32) if values.dtype.kind == "i" else values


def _closed(values: np.ndarray, nodes: tuple[int, ...]) -> np.ndarray:
    """Values (strain, node_y, node_x) at the nodes of a sheet that is repeated and closed."""
    rows, columns = (
        np.arange(count) % own for count, own in zip(nodes, values.shape[1:], strict=True)
    )
    return values[:, rows[:, None], columns]
