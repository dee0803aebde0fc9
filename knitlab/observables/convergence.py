"""Whether a case converged, and how much work its states took."""

from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.io.provenance import MODEL
from knitlab.observables.observable import curve, number, observable
from knitlab.observables.status import Status

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest


@observable(
    unrelaxed=True,
    status=number("status of the design"),
    case_id=number("identifier of the case", description="names its file under cases/"),
    code=number("version of the model that computed the design"),
    periods=number("stripe periods along a patch", integer=True),
)
def identity(test: "FinishedTest") -> dict[str, Any]:
    """What the case is, and whether it is complete."""
    return {
        "status": np.int8(Status.ok if test.complete else Status.not_converged),
        "case_id": test.case.case_id,
        "code": MODEL,
        "periods": test.case.periods,
    }


@observable(
    unrelaxed=True,
    residual_force=curve("largest residual force on a free unknown", "N"),
    iterations=curve(
        "steps of the solver, or time steps by dynamics",
        description="retried strain steps included",
        integer=True,
    ),
    factorisations=curve(
        "factorisations",
        description="of the stiffness, for all of the steps",
        integer=True,
        in_cube=False,
    ),
    snapped=curve(
        "whether the fabric snapped on the way to a strain",
        description=(
            "1 where the fabric left its branch of equilibria: even in the smallest strain "
            "step, more than branch_limit of the work was lost; not looked for by dynamics"
        ),
    ),
)
def effort(test: "FinishedTest") -> dict[str, Any]:
    """Residual and steps of every state that was tried; whether the fabric snapped to it."""
    states = test.test.states
    return {
        "residual_force": [state.residual for state in states],
        "iterations": [float(state.iterations) for state in states],
        "factorisations": [float(state.factorisations) for state in states],
        "snapped": [float(state.snapped) for state in test.reached],
    }
