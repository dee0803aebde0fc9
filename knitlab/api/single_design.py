"""One design, of whatever describes it: its case, its gauge, and what a cube says of it."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pydantic import ValidationError

from knitlab.api.design import Design
from knitlab.cube.cube_file import CUBE, cube_path, design_dims, is_case, open_cube
from knitlab.cube.selection import chosen_places, selected
from knitlab.io.errors import BadInput, Fault, fault, faults_of
from knitlab.knitting.specification import Prediction
from knitlab.knitting.stitch_chart import is_turned
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Case, case_of
from knitlab.sweep.cases import cases, electrode_problems
from knitlab.sweep.cube import gauge_of
from knitlab.sweep.design_space import design_space
from knitlab.sweep.parameters import Parameters, defaults
from knitlab.sweep.patterns import Pattern
from knitlab.sweep.plan import Plan, make_plan
from knitlab.sweep.reproduce import find_case
from knitlab.sweep.workflow import DesignSection, ElectrodesSection, ProtocolSection, Workflow
from knitlab.sweep.workflow_file import Overrides

OWN_PATTERN = "own pattern"
"""Name of a pattern that is given as an object."""
MOST_NAMED = 6
"""Designs that a message lists."""


@dataclass(frozen=True)
class SingleDesign:
    """One design.

    Attributes:
        case: its case.
        gauge: size of a stitch in cloth.
        prediction: what a cube says of it.
    """

    case: Case
    gauge: Gauge
    prediction: Prediction | None = None


def is_cube(path: str | Path) -> bool:
    """Whether a path is that of a cube, and not of a workflow."""
    return Path(path).suffix == ".nc" or (Path(path) / CUBE).is_file()


def of_design(
    design: Design,
    applied_strain: Sequence[float],
    parameters: Parameters,
    protocol: ProtocolSection,
    *,
    electrodes: bool,
) -> SingleDesign:
    """The case of a design that is given as an object.

    Args:
        design: the design.
        applied_strain: strains of its test, ascending from 0 [1].
        parameters: the settings; stripes and boundary are those of the design where it has them.
        protocol: how the states of the test are reached.
        electrodes: whether it has those of ``parameters.capacitor``.

    Raises:
        BadInput: with every fault of the design and the strains, or if settings contradict.
    """
    strains = tuple(float(strain) for strain in applied_strain)
    faults = [*_bad_strains(strains)]
    pattern = design.pattern
    if isinstance(pattern, Pattern):
        named = parameters.patterns | {OWN_PATTERN: (pattern, Path())}
        parameters, pattern = replace(parameters, patterns=named), OWN_PATTERN
    try:
        section = DesignSection(
            n_stripe=(design.n_stripe,),
            n_subunit=(design.n_subunit,),
            pattern=(pattern,) if isinstance(pattern, str) else pattern,
            unit_cells=design.unit_cells,
            needles=design.needles,
        )
    except ValidationError as error:
        raise BadInput([*faults_of(error, "Design"), *faults]) from error
    if parameters.model.boundary == "periodic" and design.boundary == "clamped":
        problem = "is periodic, and the design is clamped; give the boundary to knitlab.Design"
        faults.append(Fault("model.boundary", problem))
    if faults:
        raise BadInput(faults)
    parameters = replace(
        parameters.with_tables(model=replace(parameters.model, boundary=design.boundary)),
        stripes=parameters.stripes.with_stripes(design.stripes),
    )
    workflow = Workflow(
        title="single design",
        design=section,
        protocol=protocol,
        electrodes=ElectrodesSection() if electrodes else None,
    )
    space = design_space(section, parameters, str)
    (case,) = cases(workflow, (), space, parameters, str)
    if problems := electrode_problems(case):
        raise fault("layout", "; ".join(problems))
    return SingleDesign(replace(case, applied_strain=strains), parameters.gauge)


def of_workflow(
    workflow: str, overrides: Overrides = (), selections: Mapping[str, Any] = {}
) -> SingleDesign:
    """The design of a workflow.

    Args:
        workflow: its name, or the path of its file.
        overrides: settings that replace its own.
        selections: values by coordinate that keep some of its designs.

    Raises:
        BadInput: if the workflow or a selection is at fault, or if it is not one design.
    """
    plan = make_plan(workflow, overrides)
    places = chosen_places(_labels(plan), selections)
    labels = {dim: {_labels(plan)[dim][place] for place in at} for dim, at in places.items()}
    chosen = [
        case
        for case in plan.cases.values()
        if all(case.design[dim] in kept for dim, kept in labels.items())
    ]
    _check_is_one(plan.workflow, [case.label for case in chosen])
    return SingleDesign(chosen[0], plan.gauge)


def of_cube(cube: str | Path | xr.Dataset, selections: Mapping[str, Any]) -> SingleDesign:
    """The design of a cube or of a test.

    Its case is read from the plan or the case file beside the cube. Where there is neither, the
    workflow of the cube is planned again, which finds the case by its identifier.

    Args:
        cube: the cube, its path, or a test of :func:`knitlab.simulate`.
        selections: values by coordinate that keep some of its designs.

    Raises:
        BadInput: if the cube or a selection is at fault, if it is not one design, or if its case is
            recorded nowhere.
    """
    dataset = cube if isinstance(cube, xr.Dataset) else open_cube(cube)
    gauge = gauge_of(dataset.attrs) or defaults().gauge
    if is_case(dataset):
        case = case_of(json.loads(dataset.attrs["parameters"]))
        return SingleDesign(case, gauge, _prediction(dataset, case, "test"))
    dims = design_dims(dataset)
    kept = selected(dataset, selections).stack(design=dims)
    kept = kept.isel(design=np.flatnonzero(kept["case_id"].values != ""))
    names = [
        "  ".join(f"{dim} {label}" for dim, label in zip(dims, labels, strict=True))
        for labels in kept["design"].values.tolist()
    ]
    _check_is_one("the cube", names)
    design = kept.isel(design=0)
    source = dataset.encoding.get("source")
    folder = None if source is None else cube_path(source).parent
    name = str(dataset.attrs.get("workflow", "cube"))
    case = _recorded(str(design["case_id"].item()), folder, name)
    return SingleDesign(case, gauge, _prediction(design, case, name))


def _bad_strains(strains: Sequence[float]) -> Iterator[Fault]:
    if not strains or strains[0] != 0:
        problem = f"begins at 0, the relaxed fabric, but is {list(strains)}"
        yield Fault("applied_strain", problem)
    elif any(later <= earlier for earlier, later in pairwise(strains)):
        problem = f"ascends, but is {list(strains)}; sort it and keep each once"
        yield Fault("applied_strain", problem)


def _labels(plan: Plan) -> dict[str, np.ndarray]:
    """Labels of the designs of a plan along each of its dimensions."""
    labels: Mapping[str, Iterable[Any]] = {
        dim: dict.fromkeys(case.design[dim] for case in plan.cases.values()) for dim in plan.dims
    }
    return {dim: np.array(list(of_dim)) for dim, of_dim in labels.items()}


def _check_is_one(whole: str, designs: Sequence[str]) -> None:
    if not designs:
        raise fault("selections", f"no design of {whole} is left; select fewer values")
    if len(designs) > 1:
        some = ", ".join(" ".join(name.split()) for name in designs[:MOST_NAMED])
        more = ", …" if len(designs) > MOST_NAMED else ""
        raise fault("selections", f"{whole} has {len(designs)} designs; select one of {some}{more}")


def _recorded(case_id: str, folder: Path | None, workflow: str) -> Case:
    if folder is not None:
        try:
            return find_case(folder, case_id).case
        except BadInput:
            pass
    try:
        cases = make_plan(workflow).cases
    except BadInput:
        cases = {}
    if case_id not in cases:
        raise fault(
            case_id,
            "is recorded in no plan and no case file beside the cube; run its workflow into that"
            " folder, or name the workflow instead",
        )
    return cases[case_id]


def _prediction(design: xr.Dataset, case: Case, source: str) -> Prediction | None:
    """What a cube says of a design; None if it has no Poisson's ratio."""
    if "poisson_ratio" not in design or not np.isfinite(design["poisson_ratio"]).any():
        return None
    ratio = np.asarray(design["poisson_ratio"].values, float)
    none = np.full_like(ratio, np.nan)
    low, high = (
        np.asarray(design[f"poisson_ratio_{end}"].values, float)
        if f"poisson_ratio_{end}" in design
        else none
        for end in ("low", "high")
    )
    along_x, along_y = (
        float(design[f"relaxed_cell_{axis}"] / design[f"flat_cell_{axis}"])
        for axis in ("yx" if is_turned(case) else "xy")
    )
    strain = np.asarray(design["applied_strain"].values, float)
    cells_y, cells_x = case.cell_grid.count
    periodic = case.options.boundary == "periodic"
    sample = "periodic fabric" if periodic else f"{cells_y} × {cells_x} unit cells, clamped"
    crossing = "self_intersections" in design and bool(design["self_intersections"][0] > 0)
    return Prediction(source, sample, crossing, (along_x, along_y), strain, ratio, low, high)
