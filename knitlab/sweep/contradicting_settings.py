"""Contradicting settings: combinations that have no meaning, refused before anything runs."""

from knitlab.fabric.pattern import CELLS_PER_PERIOD
from knitlab.fabric.settings import Boundary, largest_thickness
from knitlab.io.errors import fault
from knitlab.simulation.case import Case
from knitlab.sweep.design_space import Source
from knitlab.sweep.workflow import Workflow


def check_drag(workflow: Workflow, boundary: Boundary, source: Source) -> None:
    """Refuse drag where it has no meaning.

    Raises:
        BadInput: if periodic fabric would have drag, or sensitivities be taken, which leave it out.
    """
    boundaries = workflow.stripes.boundaries if workflow.stripes else (boundary,)
    if "periodic" in boundaries:
        problem = "holds back a sample that moves between clamps; periodic fabric has no place to"
        raise fault(
            source("solver.drag"), f"{problem} move from: take boundary = clamped, or drag = 0"
        )
    if workflow.protocol.sensitivities:
        problem = "has no sensitivities, which are those of equilibria; take drag = 0"
        raise fault(source("solver.drag"), problem)


def check_contact(workflow: Workflow, drag: float, source: Source) -> None:
    """Refuse contact where it is not taken into account.

    Raises:
        BadInput: by dynamics, with drag, or with sensitivities.
    """
    if workflow.protocol.method == "dynamics":
        problem = (
            "needs equilibria, as explicit time steps cannot hold a barrier; take method ="
            " equilibrium, or contact = none"
        )
    elif drag:
        problem = "is not combined with drag; take drag = 0, or contact = none"
    elif workflow.protocol.sensitivities:
        problem = "has no sensitivities; leave them out, or take contact = none"
    else:
        return
    raise fault(source("model.contact"), problem)


def check_thickness(case: Case, source: Source) -> None:
    """Refuse a fabric so thick that contact would press open its folds at rest.

    Raises:
        BadInput: if it is.
    """
    if case.options.contact == "none":
        return
    pair, (_, fabric) = case.stripe_pair, case.assemble()
    refinement = case.options.cells_per_period // CELLS_PER_PERIOD
    sharpest = float(min(pair.weft.theta_0.min(), pair.warp.theta_0.min()))
    largest = largest_thickness(refinement * float(fabric.cell_sides.min()), sharpest)
    if case.sheet.thickness >= largest:
        problem = f"is too thick for the folds of {case.label}; give less than {largest:.3g} mm"
        raise fault(source("model.thickness"), f"{case.sheet.thickness:g} mm {problem}")
