"""The cases of a design space: what a workflow and the parameters make of each design."""

from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from knitlab.capacitance.capacitor import Capacitor
from knitlab.io.errors import fault
from knitlab.io.strict_model import StrictModel
from knitlab.mechanics.dynamics import DynamicsSettings
from knitlab.mechanics.solver import SolverSettings
from knitlab.model.electrode_layout import ElectrodeLayout
from knitlab.model.fabric import Sheet
from knitlab.model.inertia import MassAndDrag
from knitlab.model.options import Boundary, ModelOptions
from knitlab.model.stripe import (
    GARTER_STITCHES_PER_RIB_STITCH,
    Knit,
    Stripe,
    periods_per_patch,
)
from knitlab.simulation.case import Case, Label
from knitlab.simulation.stripe_changes import changed_sheet, changed_stripe
from knitlab.study.axes import SweepAxis, combinations
from knitlab.study.design_space import DesignSpace
from knitlab.study.parameters import ElectrodeParameters, Parameters, read_stripe_file
from knitlab.study.sample_size import sample_size
from knitlab.study.workflow import ElectrodesSection, ModelSection, Workflow
from knitlab.study.workflow_text import WorkflowText

# A pure stripe lies with its ridges along x, whatever its knit, and is pulled across them along y.
PULLED_ACROSS = ("G",)
STRIPE_FILES = "model.stripe_files"


def with_stripe_files(
    section: ModelSection, parameters: Parameters, text: WorkflowText
) -> Parameters:
    """The parameters, with the stripes of a workflow's ``stripe_files`` added or replaced.

    Raises:
        BadInput: with every fault of a file.
    """
    stripes = parameters.stripes
    for path in stripe_files(section, text):
        stripes = read_stripe_file(path, text.source(STRIPE_FILES)).over(stripes)
    return parameters.having(stripes)


def stripe_files(section: ModelSection, text: WorkflowText) -> list[Path]:
    """Where the ``stripe_files`` of a workflow lie."""
    return [text.folder(STRIPE_FILES) / name for name in section.stripe_files]


def cases(
    workflow: Workflow, axes: tuple[SweepAxis, ...], space: DesignSpace, parameters: Parameters
) -> Iterator[Case]:
    """Every case of a workflow: every design under every combination of the axes' values."""
    for labels, chosen in combinations(workflow, axes):
        yield from _cases(chosen, labels, space, parameters)


def _cases(
    workflow: Workflow, labels: dict[str, Label], space: DesignSpace, parameters: Parameters
) -> Iterator[Case]:
    protocol = workflow.protocol
    sheet = changed_sheet(_values(parameters.sheet), workflow.model)
    reading = merged(parameters.reading, workflow.model)
    common: dict[str, Any] = {
        "sheet": Sheet(**_of(Sheet, sheet)),
        "mass_and_drag": None,
        "applied_strain": protocol.applied_strain,
        "method": protocol.method,
        "solver": SolverSettings(**merged(parameters.solver, workflow.solver)),
        "sensitivities": protocol.sensitivities,
        "unloading": protocol.unloading,
        "robustness": protocol.robustness if protocol.method == "equilibrium" else 0,
        "capacitor": _capacitor(workflow.electrodes, parameters.electrodes),
    }
    if protocol.method == "dynamics":
        common["mass_and_drag"] = MassAndDrag(**_of(MassAndDrag, sheet))
        common["solver"] = DynamicsSettings(**merged(parameters.dynamics, workflow.dynamics))
    elif common["solver"].drag:
        _check_drag(workflow, reading["boundary"])

    def stripe(knit: Knit, stitches: int) -> Stripe:
        return changed_stripe(parameters.stripes.stripe(knit, stitches), workflow.model)

    if workflow.design is not None:
        for n_stripe, n_subunit in space.designs:
            n, m = int(n_stripe), int(n_subunit)
            yield Case(
                design={"n_stripe": n, "n_subunit": m, **labels},
                weft=stripe("rib", n),
                warp=stripe("garter", GARTER_STITCHES_PER_RIB_STITCH * n),
                reading=ModelOptions(**reading),
                pattern=workflow.design.pattern,
                periods=periods_per_patch(n, m),
                unit_cells=sample_size(workflow.design, m),
                **common,
            )
    elif workflow.stripes is not None:
        for knit, stitches, boundary in space.designs:
            pure = stripe("rib" if knit == "rib" else "garter", int(stitches))
            yield Case(
                design={"knit": knit, "n": stitches, "boundary": boundary, **labels},
                weft=pure,
                warp=pure,
                reading=ModelOptions(**reading | {"boundary": boundary}),
                pattern=PULLED_ACROSS,
                periods=workflow.stripes.stripe_periods,
                unit_cells=(1, 1),
                **common,
            )


def _check_drag(workflow: Workflow, boundary: Boundary) -> None:
    """Refuse drag where it has no meaning.

    Raises:
        BadInput: if fabric without end would be dragged, or derivatives be taken that know of no
            drag.
    """
    boundaries = workflow.stripes.boundaries if workflow.stripes else (boundary,)
    if "periodic" in boundaries:
        problem = "holds back a sample that moves between clamps; periodic fabric has no place to"
        raise fault("solver.drag", f"{problem} move from: take boundary = clamped, or drag = 0")
    if workflow.protocol.sensitivities:
        problem = "has no sensitivities, which are those of equilibria; take drag = 0"
        raise fault("solver.drag", problem)


def _capacitor(
    section: ElectrodesSection | None, parameters: ElectrodeParameters
) -> Capacitor | None:
    if section is None:
        return None
    given = section.model_dump(exclude_none=True)
    if section.layout is not None and section.layout not in parameters.layouts:
        known = ", ".join(parameters.layouts)
        problem = f"there is no layout {section.layout!r}; choose of {known}, or give a mask"
        raise fault("electrodes.layout", problem)
    layout = ElectrodeLayout()
    if section.layout is not None:
        named = parameters.layouts[section.layout].model_dump(exclude={"source"})
        layout = ElectrodeLayout(**named)
    layout = replace(layout, **{key: its for key, its in given.items() if hasattr(layout, key)})
    numbers = {
        name: given.get(name, getattr(parameters, name).value)
        for name in type(parameters).model_fields
        if name != "layouts"
    }
    return Capacitor(layout=layout, **numbers)


def merged(parameters: StrictModel, section: StrictModel) -> dict[str, Any]:
    """Values of a parameter file, each replaced where the workflow's section has one."""
    given = section.model_dump(exclude_none=True)
    return {key: given.get(key, value) for key, value in _values(parameters).items()}


def _values(parameters: StrictModel) -> dict[str, Any]:
    return {key: getattr(parameters, key).value for key in type(parameters).model_fields}


def _of(kind: type, values: dict[str, Any]) -> dict[str, Any]:
    return {field.name: values[field.name] for field in fields(kind)}
