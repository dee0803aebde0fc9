"""The cases of a design space: what a workflow and the parameters make of each design."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from knitlab.mechanics.dynamics import DynamicsSettings
from knitlab.mechanics.newton import SolverSettings
from knitlab.model.fabric import Sheet
from knitlab.model.inertia import MassAndDrag
from knitlab.model.reading import Reading
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, periods_per_patch
from knitlab.sweep.case import Case
from knitlab.sweep.design_space import DesignSpace
from knitlab.sweep.parameters import Parameters, Strict, read_stripe_file
from knitlab.sweep.workflow import ModelSection, Workflow
from knitlab.sweep.workflow_text import WorkflowText

# A pure stripe lies with its ridges along x, whatever its knit, and is pulled across them along y.
PULLED_ACROSS = ("G",)


def with_stripe_files(
    section: ModelSection, parameters: Parameters, text: WorkflowText
) -> Parameters:
    """The parameters, with the stripes of a workflow's ``stripe_files`` added or replaced.

    Raises:
        BadInput: with every fault of a file.
    """
    key = "model.stripe_files"
    stripes = parameters.stripes
    for name in section.stripe_files:
        stripes = read_stripe_file(text.folder(key) / name, text.source(key)).over(stripes)
    return parameters.having(stripes)


def cases(workflow: Workflow, space: DesignSpace, parameters: Parameters) -> Iterator[Case]:
    """Every case of a workflow, in order."""
    protocol = workflow.protocol
    steps = round(protocol.strain_max / protocol.strain_step)
    sheet = _merged(parameters.sheet, workflow.model)
    reading = _merged(parameters.reading, workflow.model)
    common: dict[str, Any] = {
        "sheet": Sheet(**_of(Sheet, sheet)),
        "mass_and_drag": None,
        "applied_strain": tuple(
            round(step * protocol.strain_step, 12) for step in range(steps + 1)
        ),
        "method": protocol.method,
        "solver": SolverSettings(**_merged(parameters.solver, workflow.solver)),
    }
    if protocol.method == "dynamics":
        common["mass_and_drag"] = MassAndDrag(**_of(MassAndDrag, sheet))
        common["solver"] = DynamicsSettings(**_merged(parameters.dynamics, workflow.dynamics))

    stripe = parameters.stripes.stripe
    if workflow.design is not None:
        for n_stripe, n_subunit in space.designs:
            n, m = int(n_stripe), int(n_subunit)
            yield Case(
                design={"n_stripe": n, "n_subunit": m},
                weft=stripe("rib", n),
                warp=stripe("garter", GARTER_STITCHES_PER_RIB_STITCH * n),
                reading=Reading(**reading),
                pattern=workflow.design.pattern,
                periods=periods_per_patch(n, m),
                unit_cells=workflow.design.unit_cells,
                **common,
            )
    elif workflow.stripes is not None:
        for knit, stitches, boundary in space.designs:
            pure = stripe("rib" if knit == "rib" else "garter", int(stitches))
            yield Case(
                design={"knit": knit, "n": stitches, "boundary": boundary},
                weft=pure,
                warp=pure,
                reading=Reading(**reading | {"boundary": boundary}),
                pattern=PULLED_ACROSS,
                periods=workflow.stripes.stripe_periods,
                unit_cells=(1, 1),
                **common,
            )


def _merged(parameters: Strict, section: Strict) -> dict[str, Any]:
    """Values of a parameter file, each replaced where the workflow's section has one."""
    given = section.model_dump(exclude_none=True)
    return {
        key: given.get(key, getattr(parameters, key).value) for key in type(parameters).model_fields
    }


def _of(kind: type, values: dict[str, Any]) -> dict[str, Any]:
    return {field.name: values[field.name] for field in fields(kind)}
