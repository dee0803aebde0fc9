"""The target of a fit: an imported test, scaled to the sample of a workflow."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from knitlab.cube.common_settings import parameters_of
from knitlab.cube.cube_file import is_measured
from knitlab.cube.schema import CYCLE, DESIGN_DIMS, Status
from knitlab.io.errors import fault
from knitlab.laboratory.simulated_test import QUANTITIES
from knitlab.simulation.case import Case
from knitlab.sweep.plan import Plan

FEWEST_STRAINS = 3
NO_ERROR = 1.0  # error of a missing value, which does not affect the misfit

Curves = Float[np.ndarray, "quantity strain"]
"""Values of :data:`~knitlab.laboratory.simulated_test.QUANTITIES`."""


@dataclass(frozen=True)
class MeasuredTest:
    """A measured test, scaled to the width of the simulated sample."""

    applied_strain: tuple[float, ...]  # positive, ascending
    values: Curves  # NaN where not measured
    errors: Curves  # positive standard errors

    def __repr__(self) -> str:
        values, strains = int(self.measured.sum()), len(self.applied_strain)
        return f"<MeasuredTest: {values} values at {strains} strains>"

    @property
    def measured(self) -> Bool[np.ndarray, "quantity strain"]:
        """Whether each value is measured."""
        return np.isfinite(self.values)

    def misfit(self, curves: Curves) -> Float[np.ndarray, " value"]:
        """Differences of curves from the measured values, in standard errors."""
        return ((curves - self.values) / self.errors)[self.measured]

    def chi_squared(self, curves: Curves) -> float:
        """χ² of curves."""
        misfit = self.misfit(curves)
        return float(misfit @ misfit)

    def root_mean_square(self, curves: Curves) -> dict[str, float]:
        """Root mean square difference of curves from the measured ones, in their units."""
        difference = np.where(self.measured, curves - self.values, 0.0)
        mean_square = (difference**2).sum(axis=1) / self.measured.sum(axis=1).clip(1)
        return dict(zip(QUANTITIES, np.sqrt(mean_square).tolist(), strict=True))


def target_of(experiment: xr.Dataset, case: Case, model_error: float) -> MeasuredTest:
    """The measured curves of an experiment, scaled to the number of unit cells across a case.

    ``model_error`` is the fraction of the largest value of a curve that is added in quadrature to
    its standard errors. BadInput if it is not a single test with markers or force.
    """
    cell = experiment.squeeze(drop=False)
    if CYCLE in cell.dims:
        raise fault("fit", f"takes one cycle; select {CYCLE}=1")
    strains = cell["applied_strain"].values
    across = case.unit_cells[1] / parameters_of(experiment)["unit_cells"][1]
    values, errors = np.full((2, len(QUANTITIES), len(strains)), np.nan)
    for place, name in enumerate(QUANTITIES):
        if name not in cell:
            continue
        scale = across if name == "reaction_force" else 1.0
        values[place] = scale * cell[name].values
        known = np.nan_to_num(scale * cell[f"{name}_error"].values)
        errors[place] = np.hypot(known, model_error * np.nanmax(np.abs(values[place])))
    pulled = (strains > 0) & np.isfinite(values).any(axis=0)
    if pulled.sum() < FEWEST_STRAINS:
        problem = f"needs at least {FEWEST_STRAINS} strains; import markers or the tensile test"
        raise fault("fit", problem)
    values, errors = values[:, pulled], errors[:, pulled]
    if not (errors[np.isfinite(values)] > 0).all():
        raise fault("model_error 0", "leaves values without an error; give one above 0")
    errors = np.nan_to_num(errors, nan=NO_ERROR)
    return MeasuredTest(tuple(strains[pulled].tolist()), values, errors)


def case_for(plan: Plan, experiment: xr.Dataset) -> Case:
    """The one case of a plan with the design of an experiment; BadInput if it cannot be fitted."""
    if not is_measured(experiment):
        raise fault("fit", "needs an experiment, and this cube was simulated; import one")
    wanted = {dim: int(experiment[dim].values[0]) for dim in DESIGN_DIMS}
    cases = [case for case in plan.cases.values() if wanted.items() <= case.design.items()]
    if len(cases) != 1:
        remedy = "one value of each setting" if cases else "n_stripe and n_subunit"
        named = f"({wanted['n_stripe']}, {wanted['n_subunit']})"
        problem = f"must have one case of {named}, and has {len(cases)}; set {remedy}"
        raise fault(plan.workflow, problem)
    (case,) = cases
    if case.method != "equilibrium":
        raise fault(plan.workflow, "uses dynamics; set method = equilibrium")
    if int(experiment["status"].values.flat[0]) != Status.ok:
        raise fault("fit", "needs an experiment that is ok, and this one is not; import it again")
    # A test that continues from another cannot keep clear of contact.
    options = replace(case.options, contact="none")
    return replace(case, options=options, capacitor=None, sensitivities=False, unloading=False)
