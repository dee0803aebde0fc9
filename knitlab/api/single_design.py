"""The one design that settings and selections leave of a workflow, a cube or a test, to knit it."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.api.cubes import as_cube
from knitlab.cubes.cube_file import is_case
from knitlab.cubes.normalised import require
from knitlab.cubes.recorded_case import recorded_case
from knitlab.cubes.selection import only_design
from knitlab.export.knitting.specification import Prediction
from knitlab.export.knitting.stitch_chart import is_turned
from knitlab.io import cube_path
from knitlab.io.errors import InputError, Mistake, invalid, raise_if_any
from knitlab.model.settings import PlainKnit
from knitlab.model.stitches import Gauge
from knitlab.runs.cube import read_gauge
from knitlab.runs.declared_fields import declared
from knitlab.runs.parameters import defaults
from knitlab.runs.plan import make_plan
from knitlab.runs.reproduce import find_case
from knitlab.runs.workflow_file import Overrides, read_overrides
from knitlab.runs.yarn import YarnOnMachine
from knitlab.solvers.case import Case


class SingleDesign(NamedTuple):
    """A case, the size of a stitch in its cloth, and what a cube says of it, if one is given."""

    case: Case
    gauge: Gauge
    prediction: Prediction | None = None
    material: str | None = None
    yarn: YarnOnMachine | None = None  # what the material says of its yarn and machine
    plain: PlainKnit | None = None  # of the material, if a workflow names the design


def single_design(
    source: str | Path | xr.Dataset, settings: Overrides, selections: Mapping[str, Any]
) -> SingleDesign:
    """The one design that settings and selections leave of a workflow, a cube or a test."""
    if not is_cube(source):
        plan = make_plan(str(source), settings)
        designs = pd.MultiIndex.from_tuples(plan.designs.values(), names=plan.dims)
        ids = pd.Series([*plan.cases], designs, name="case_id").to_xarray().fillna("").to_dataset()
        case_id = only_design(ids, selections, plan.workflow)["case_id"].item()
        return SingleDesign(
            plan.cases[case_id], plan.gauge, None, plan.material, plan.yarn, plan.plain
        )
    single = _of_cube(as_cube(source), selections)
    given, mistakes = read_overrides(settings)
    values = {override.name: override.value for override in given}
    known = declared(Gauge)
    message = f"cannot change a simulated cube; set {' or '.join(known)}, or select a design"
    mistakes += [Mistake(f"settings {name}", message) for name in values if name not in known]
    raise_if_any(mistakes)
    return single._replace(gauge=replace(single.gauge, **values))


def is_cube(source: str | Path | xr.Dataset) -> bool:
    """Whether this is a cube, a test, or the path of a cube, and no workflow."""
    return not isinstance(source, str | Path) or cube_path.is_cube(source)


def _of_cube(cube: xr.Dataset, selections: Mapping[str, Any]) -> SingleDesign:
    """The design of a cube or of a test."""
    gauge = read_gauge(cube.attrs) or defaults().gauge
    material = cube.attrs.get("material")
    yarn = None if material is None else YarnOnMachine.of_attributes(cube.attrs)
    if is_case(cube):
        case = recorded_case(cube)
        return SingleDesign(case, gauge, _prediction(cube, case, "test"), material, yarn)
    require(cube, ["case_id"], "designs to make")
    design = only_design(cube, selections)
    source = cube.encoding.get("source")
    folder = None if source is None else cube_path.cube_path(source).parent
    name = str(cube.attrs.get("workflow", "cube"))
    case = _recorded(str(design["case_id"].item()), folder, name)
    return SingleDesign(case, gauge, _prediction(design, case, name), material, yarn)


def _recorded(case_id: str, folder: Path | None, workflow: str) -> Case:
    """The case in the plan or the case files beside a cube, or else in a new plan."""
    if folder is not None:
        with suppress(InputError):
            return find_case(folder, case_id).case
    with suppress(InputError, KeyError):
        return make_plan(workflow).cases[case_id]
    message = "is recorded in no plan and no case file beside the cube; run its workflow into that"
    raise invalid(case_id, f"{message} folder, or name the workflow instead")


def _prediction(design: xr.Dataset, case: Case, source: str) -> Prediction | None:
    """What a cube says of a design, if it has a Poisson's ratio."""
    if "poisson_ratio" not in design or not np.isfinite(design["poisson_ratio"]).any():
        return None
    ratio = design["poisson_ratio"].astype(float)
    ends = (design.get(f"poisson_ratio_{end}", np.nan * ratio) for end in ("low", "high"))
    low, high = (np.asarray(end, float) for end in ends)
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
