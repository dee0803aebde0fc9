"""One design of a workflow, a cube or a test: its case, its gauge, and what a cube says of it."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import CUBE, cube_path, design_dims, is_case, open_cube
from knitlab.cube.selection import chosen_places, selected
from knitlab.io.errors import BadInput, fault
from knitlab.knitting.specification import Prediction
from knitlab.knitting.stitch_chart import is_turned
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Case, case_of
from knitlab.sweep.cube import gauge_of
from knitlab.sweep.parameters import defaults
from knitlab.sweep.plan import make_plan
from knitlab.sweep.reproduce import find_case
from knitlab.sweep.workflow_file import Overrides

MOST_NAMED = 6
"""Designs that a message lists."""


class SingleDesign(NamedTuple):
    """A case, the size of a stitch in its cloth, and what a cube says of it, if one is given."""

    case: Case
    gauge: Gauge
    prediction: Prediction | None = None


def single_design(
    source: str | Path | xr.Dataset, settings: Overrides, selections: Mapping[str, Any]
) -> SingleDesign:
    """The design that settings of a workflow, and selections, leave.

    Args:
        source: a workflow by its name or path; or a cube, its path, or a test.
        settings: settings that replace those of a workflow.
        selections: values by coordinate that keep some of its designs.

    Raises:
        BadInput: if one of these is at fault, if it is not one design, or if its case is recorded
            nowhere.
    """
    if not (isinstance(source, xr.Dataset) or is_cube(source)):
        return _of_workflow(str(source), settings, selections)
    if settings:
        raise fault("settings", "belong to workflows; select a design of a cube instead")
    return _of_cube(source if isinstance(source, xr.Dataset) else open_cube(source), selections)


def is_cube(path: str | Path) -> bool:
    """Whether a path is that of a cube, and not of a workflow."""
    return Path(path).suffix == ".nc" or (Path(path) / CUBE).is_file()


def _of_workflow(
    workflow: str, overrides: Overrides, selections: Mapping[str, Any]
) -> SingleDesign:
    plan = make_plan(workflow, overrides)
    designs = list(plan.cases.values())
    labels = {
        dim: np.array(list(dict.fromkeys(case.design[dim] for case in designs)))
        for dim in plan.dims
    }
    for dim, kept in chosen_places(labels, selections).items():
        designs = [case for case in designs if case.design[dim] in labels[dim][kept]]
    _check_is_one(plan.workflow, [case.label for case in designs])
    return SingleDesign(designs[0], plan.gauge)


def _of_cube(cube: xr.Dataset, selections: Mapping[str, Any]) -> SingleDesign:
    """The design of a cube or of a test.

    Its case is read from the plan or the case file beside the cube. Where there is neither, the
    workflow of the cube is planned again, which finds the case by its identifier.
    """
    gauge = gauge_of(cube.attrs) or defaults().gauge
    if is_case(cube):
        case = case_of(json.loads(cube.attrs["parameters"]))
        return SingleDesign(case, gauge, _prediction(cube, case, "test"))
    dims = design_dims(cube)
    kept = selected(cube, selections).stack(design=dims)
    kept = kept.isel(design=np.flatnonzero(kept["case_id"].values != ""))
    names = [
        "  ".join(f"{dim} {label}" for dim, label in zip(dims, labels, strict=True))
        for labels in kept["design"].values.tolist()
    ]
    _check_is_one("the cube", names)
    design = kept.isel(design=0)
    source = cube.encoding.get("source")
    folder = None if source is None else cube_path(source).parent
    name = str(cube.attrs.get("workflow", "cube"))
    case = _recorded(str(design["case_id"].item()), folder, name)
    return SingleDesign(case, gauge, _prediction(design, case, name))


def _check_is_one(whole: str, designs: Sequence[str]) -> None:
    if not designs:
        raise fault("selections", f"no design of {whole} is left; select fewer values")
    if len(designs) > 1:
        some = ", ".join(" ".join(name.split()) for name in designs[:MOST_NAMED])
        more = ", …" if len(designs) > MOST_NAMED else ""
        raise fault("selections", f"{whole} has {len(designs)} designs; select one of {some}{more}")


def _recorded(case_id: str, folder: Path | None, workflow: str) -> Case:
    if folder is not None:
        with suppress(BadInput):
            return find_case(folder, case_id).case
    with suppress(BadInput, KeyError):
        return make_plan(workflow).cases[case_id]
    raise fault(
        case_id,
        "is recorded in no plan and no case file beside the cube; run its workflow into that"
        " folder, or name the workflow instead",
    )


def _prediction(design: xr.Dataset, case: Case, source: str) -> Prediction | None:
    """What a cube says of a design; None if it has no Poisson's ratio."""
    if "poisson_ratio" not in design or not np.isfinite(design["poisson_ratio"]).any():
        return None
    ratio = design["poisson_ratio"].astype(float)
    low, high = (
        np.asarray(design.get(f"poisson_ratio_{end}", np.nan * ratio), float)
        for end in ("low", "high")
    )
    along_x, along_y = (
        float(design[f"relaxed_cell_{axis}"] / design[f"flat_cell_{axis}"])
        for axis in ("yx" if is_turned(case) else "xy")
    )
    cells_y, cells_x = case.cell_grid.count
    periodic = case.options.boundary == "periodic"
    return Prediction(
        source,
        "periodic fabric" if periodic else f"{cells_y} × {cells_x} unit cells, clamped",
        "self_intersections" in design and bool(design["self_intersections"][0] > 0),
        (along_x, along_y),
        np.asarray(design["applied_strain"], float),
        ratio.values,
        low,
        high,
    )
