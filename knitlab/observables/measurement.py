"""Measurement of a finished test: all variables of a case, as a labelled dataset."""

from typing import Any

import numpy as np
import xarray as xr

from knitlab.observables.case_variables import FIXED_COORDINATES, fixed_coordinates, variables_of
from knitlab.observables.finished_test import FinishedTest
from knitlab.observables.observable import REGISTRY
from knitlab.observables.schema import described
from knitlab.solvers.case import Case


def measured(test: FinishedTest) -> xr.Dataset:
    """Dataset of a case: its variables at every strain of the protocol.

    Values are missing at strains that did not converge or were not tried; ``residual_force`` and
    ``iterations`` have values at every strain that was tried. Variables of the whole test are
    missing unless all strains converged.
    """
    case = test.case
    values: dict[str, Any] = {}
    for each in REGISTRY.observables:
        if each.group.has is not None and each.group.has(case):
            values |= each.values(test)
    return described(_dataset(case, values))


def _dataset(case: Case, values: dict[str, Any]) -> xr.Dataset:
    """The variables of a case, padded along ``applied_strain`` with missing values."""
    shape = case.mesh_shape
    sizes = {
        "applied_strain": len(case.applied_strain),
        "cell_y": case.cell_grid.count[0],
        "cell_x": case.cell_grid.count[1],
        **{name: len(labels) for name, labels in FIXED_COORDINATES.items()},
        "node_y": shape.nodes_y,
        "node_x": shape.nodes_x,
        "component": 3,
        "time": len(values.get("time", ())),
        "snapshot": len(values.get("snapshot", ())),
    }
    variables: dict[str, Any] = {}
    for name, variable in variables_of(case).items():
        if not variable.dims:
            variables[name] = ((), values.get(name, np.nan))
        elif name in values or variable.in_cube:
            padded = np.full([sizes[dim] for dim in variable.dims], np.nan)
            if name in values:
                padded[: len(values[name])] = values[name]
            variables[name] = (variable.dims, padded)
    coordinates: dict[str, Any] = {
        **case.design,
        "applied_strain": list(case.applied_strain),
        "cell_y": np.arange(sizes["cell_y"]),
        "cell_x": np.arange(sizes["cell_x"]),
    }
    coordinates |= {name: values[name] for name in ("time", "snapshot") if name in values}
    coordinates |= fixed_coordinates({dim for dims, _ in variables.values() for dim in dims})
    if "position" in variables:
        coordinates["component"] = ["x", "y", "z"]
    return xr.Dataset(variables, coordinates)
