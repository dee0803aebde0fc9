"""Laboratory records: importing them as cubes, and fitting stripes to them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from knitlab.api.comparison import Cube, opened
from knitlab.io.errors import fault
from knitlab.laboratory.description import RecordKind
from knitlab.laboratory.experiment import Imported
from knitlab.laboratory.experiment import import_records as import_kind
from knitlab.laboratory.fit import Fit, NoFit, Step, fit_stripes
from knitlab.laboratory.target import case_for, target_of
from knitlab.sweep.plan import Plan, make_plan


def import_records(
    kind: RecordKind, description: str | Path, *, results: str | Path = "results"
) -> Imported:
    """Import the records that a TOML file describes into a cube.

    Args:
        kind: ``"markers"``, ``"tensile"`` or ``"capacitance"``.
        description: TOML file that describes the records, their units and the sample.
        results: folder that holds a folder of results for each experiment.

    Returns:
        The cube, its path, and a summary of the records in lines of text.

    Raises:
        BadInput: with every fault of the description and its records.
    """
    return import_kind(kind, Path(description), Path(results))


def fit(
    experiment: Cube,
    workflow: str | Path | Plan,
    *,
    looseness: float = 0.2,
    model_error: float = 0.01,
    starts: int = 4,
    step: Step = lambda tests, chi_squared: None,
    **settings: Any,
) -> Fit:
    """Fit k_s, k_t and θ0 of both stripes to a test of a whole fabric.

    The sample is the only case of the workflow with the design of the experiment. It is simulated
    about ten to thirty times.

    Args:
        experiment: cube of one experiment on one design, in one cycle.
        workflow: name or path of a workflow that has the design, or its plan.
        looseness: relative standard deviation of the tabulated stripes, as a prior.
        model_error: error of the model, as a fraction of the largest value of a curve.
        starts: largest number of starts that are tried until the test is matched.
        step: called after every test with the number of tests and χ² of the last.
        settings: settings of the workflow to replace.

    Returns:
        The fitted stripes with their standard errors, curves and warnings.

    Raises:
        BadInput: if the experiment cannot be fitted, the workflow has no such design, or settings
            are given beside a plan.
    """
    if isinstance(workflow, Plan) and settings:
        raise fault("settings", "belong to workflows; plan the workflow with them")
    plan = workflow if isinstance(workflow, Plan) else make_plan(str(workflow), settings)
    cube = opened(experiment)
    case = case_for(plan, cube)
    target = target_of(cube, case, model_error)
    case = replace(case, applied_strain=(0.0, *target.applied_strain))
    try:
        return fit_stripes(case, target, looseness, starts=starts, step=step)
    except NoFit as problem:
        remedy = "choose a smaller strain_max, or another sample"
        raise fault(plan.workflow, f"{problem}; {remedy}") from problem
