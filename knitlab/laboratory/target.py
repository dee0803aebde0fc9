"""The target of a fit: an imported test, scaled to the sample of a workflow."""

from dataclasses import replace

import numpy as np
import xarray as xr

from knitlab.cube.common_settings import parameters_of
from knitlab.cube.cube_file import is_measured
from knitlab.cube.schema import CYCLE, DESIGN_DIMS, Status
from knitlab.io.errors import fault
from knitlab.laboratory.fit import MeasuredTest
from knitlab.laboratory.simulated_test import QUANTITIES
from knitlab.simulation.case import Case
from knitlab.sweep.plan import Plan

FEWEST_STRAINS = 3
NO_ERROR = 1.0
"""Error of a missing value, which does not affect the misfit."""


def target_of(experiment: xr.Dataset, case: Case, model_error: float) -> MeasuredTest:
    """The measured curves of an experiment, scaled to the sample of a case.

    Args:
        experiment: cube of the experiment.
        case: the simulated sample; the force is scaled to its number of unit cells across.
        model_error: fraction of the largest value of a curve that is added in quadrature to its
            standard errors, for the error of the model.

    Raises:
        BadInput: if it is not a single test with markers or force.
    """
    cell = experiment.squeeze(drop=False)
    if CYCLE in cell.dims:
        raise fault("fit", f"takes one cycle; select {CYCLE}=1")
    strains = cell["applied_strain"].values
    across = case.unit_cells[1] / parameters_of(experiment)["unit_cells"][1]
    values, errors = (np.full((len(QUANTITIES), len(strains)), np.nan) for _ in range(2))
    for place, name in enumerate(QUANTITIES):
        if name not in cell:
            continue
        scale = across if name == "reaction_force" else 1.0
        values[place] = scale * cell[name].values
        known = np.nan_to_num(scale * cell[f"{name}_error"].values)
        errors[place] = np.hypot(known, model_error * np.nanmax(np.abs(values[place])))
    pulled = (strains > 0) & np.isfinite(values).any(axis=0)
    if pulled.sum() < FEWEST_STRAINS:
        raise fault(
            "fit", f"needs at least {FEWEST_STRAINS} strains; import markers or the tensile test"
        )
    if not (errors[:, pulled][np.isfinite(values[:, pulled])] > 0).all():
        raise fault("model_error 0", "leaves values without an error; give one above 0")
    return MeasuredTest(
        tuple(strains[pulled].tolist()),
        values[:, pulled],
        np.nan_to_num(errors[:, pulled], nan=NO_ERROR),
    )


def case_for(plan: Plan, experiment: xr.Dataset) -> Case:
    """The case of a plan with the design of an experiment.

    Raises:
        BadInput: if there is none, or several, or it cannot be fitted.
    """
    if not is_measured(experiment):
        raise fault("fit", "needs an experiment, and this cube was simulated; import one")
    wanted = {dim: int(experiment[dim].values[0]) for dim in DESIGN_DIMS}
    cases = [
        case
        for case in plan.cases.values()
        if all(case.design.get(dim) == label for dim, label in wanted.items())
    ]
    named = f"({wanted['n_stripe']}, {wanted['n_subunit']})"
    if len(cases) != 1:
        remedy = "one value of each setting" if cases else "n_stripe and n_subunit"
        problem = f"must have one case of {named}, and has {len(cases)}; set {remedy}"
        raise fault(plan.workflow, problem)
    (case,) = cases
    if case.method != "equilibrium":
        raise fault(plan.workflow, "uses dynamics; set method = equilibrium")
    if int(experiment["status"].values.flat[0]) != Status.ok:
        raise fault("fit", "needs an experiment that is ok, and this one is not; import it again")
    return replace(case, capacitor=None, sensitivities=False, unloading=False)


def at_strains_of(case: Case, target: MeasuredTest) -> Case:
    """The case at the strains of a target."""
    return replace(case, applied_strain=(0.0, *target.applied_strain))
