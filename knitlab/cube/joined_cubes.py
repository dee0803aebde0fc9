"""Several cubes as one: every design of all of them, on one labelled grid. Needs no JAX."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.common_settings import ATTRIBUTE, parameters_of, shared
from knitlab.cube.cube_file import design_dims
from knitlab.cube.design_status import Status
from knitlab.cube.schema import VARIABLES

PRECEDENCE = {
    Status.excluded: 0,
    Status.pending: 1,
    Status.failed: 2,
    Status.not_converged: 3,
    Status.ok: 3,
}
"""Of several cubes, a design is taken from the one with the highest; the first of equals."""


def joined_cubes(cubes: Sequence[xr.Dataset]) -> xr.Dataset:
    """One cube with the designs of several.

    A design with results is taken before one without; of several with results, that of the first
    cube.

    Args:
        cubes: one or more cubes along the same design dimensions.

    Returns:
        The cube, with the attributes of the first one; its ``parameters`` are those that all share.
    """
    first, *others = cubes
    if not others:
        return first.copy()
    dims = design_dims(first)
    labels = {dim: _union([cube[dim].values.tolist() for cube in cubes]) for dim in dims}
    coordinates: dict[str, Any] = {
        "applied_strain": np.unique(np.concatenate([cube["applied_strain"] for cube in cubes]))
    }
    for name in ("cell_y", "cell_x"):
        coordinates[name] = np.arange(max(cube.sizes[name] for cube in cubes))
    for cube in cubes:
        for name in map(str, cube.dims):
            if name not in (*dims, *coordinates):
                coordinates[name] = cube[name].values
    grid = tuple(len(labels[dim]) for dim in dims)
    arrays: dict[str, np.ndarray] = {}
    for name in (name for name in VARIABLES if any(name in cube for cube in cubes)):
        kind = next(cube[name].dtype for cube in cubes if name in cube)
        shape = (*grid, *(len(coordinates[dim]) for dim in VARIABLES[name].dims))
        # Text, the status, and numbers, of which those that are integers were read as floats.
        empty = "" if kind.kind in "OU" else Status.excluded if name == "status" else np.nan
        arrays[name] = np.full(shape, empty, object if kind.kind in "OU" else kind)
    best = np.zeros(grid, int)
    for cube in cubes:
        _add(cube, arrays, best, labels, coordinates["applied_strain"])

    described = {str(name): each.attrs for cube in cubes for name, each in cube.variables.items()}
    joined = xr.Dataset(
        {name: ((*dims, *VARIABLES[name].dims), array) for name, array in arrays.items()},
        {**labels, **coordinates},
        first.attrs,
    )
    for name, attributes in described.items():
        joined[name].attrs |= attributes
    common = parameters_of(first)
    for cube in others:
        common = shared(common, parameters_of(cube))
    joined.attrs[ATTRIBUTE] = json.dumps(common)
    return joined


def _union(labels: Sequence[list[Any]]) -> list[Any]:
    """All labels of a dimension: numbers in ascending order, texts in order of appearance."""
    found = list(dict.fromkeys(label for along in labels for label in along))
    return found if any(isinstance(label, str) for label in found) else sorted(found)


def _add(
    cube: xr.Dataset,
    arrays: dict[str, np.ndarray],
    best: np.ndarray,
    labels: dict[str, list[Any]],
    strains: np.ndarray,
) -> None:
    """Add the designs of a cube to the arrays of the joined one, where they take precedence."""
    places = [
        [rank[label] for label in cube[dim].values.tolist()]
        for dim in labels
        for rank in [{label: k for k, label in enumerate(labels[dim])}]
    ]
    block = np.ix_(*places)
    status = cube["status"].values
    rank = np.vectorize(PRECEDENCE.get, otypes=[int])(status)
    better = rank > best[block]
    best[block] = np.maximum(rank, best[block])
    chosen = np.nonzero(better)
    target = tuple(np.asarray(along)[index] for along, index in zip(places, chosen, strict=True))
    rows = np.searchsorted(strains, cube["applied_strain"].values)
    for name, array in arrays.items():
        array[target] = np.nan if array.dtype.kind == "f" else "" if array.dtype == object else 0
        if name not in cube:
            continue
        values = cube[name].values[chosen]
        for axis, dim in enumerate(VARIABLES[name].dims, start=1):
            along = rows if dim == "applied_strain" else np.arange(cube.sizes[dim])
            # Cubes may have fewer strains or unit cells than the joined one.
            wider = np.full(
                (
                    *values.shape[:axis],
                    array.shape[axis - 1 + status.ndim],
                    *values.shape[axis + 1 :],
                ),
                np.nan,
                array.dtype,
            )
            wider[(slice(None),) * axis + (along,)] = values
            values = wider
        array[target] = values
