"""Tests that a fit compares: one measured, and simulated ones with changed stripes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from knitlab.cubes.cube_file import cells_across, is_measured
from knitlab.io.errors import invalid
from knitlab.model.energy import Point
from knitlab.model.fabric import Configuration
from knitlab.model.stripe import STRIPE_QUANTITIES, Stripe
from knitlab.observables.schema import CYCLE, DESIGN_DIMS
from knitlab.observables.sensitivity import Quantity, adjoint_of, logarithmic, measured_by
from knitlab.observables.status import Status
from knitlab.runs.plan import Plan
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.equilibrium import find_equilibrium, run_each
from knitlab.solvers.equilibrium.method import Equilibrium
from knitlab.solvers.equilibrium.search import SearchRules
from knitlab.solvers.equilibrium.state import State
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.equilibrium.tensile_test import relax
from knitlab.solvers.loads.loading import loading_of

QUANTITIES = ("mean_strain_xx", "mean_strain_yy", "reaction_force")  # of a test, in this order
MIN_STRAINS = 3
NO_ERROR = 1.0  # error of a missing value, which does not affect the misfit

Curves = Float[np.ndarray, "quantity strain"]  # values of QUANTITIES at strains above 0


@dataclass(frozen=True)
class MeasuredTest:
    """A measured test, scaled to the width of the simulated sample."""

    applied_strain: tuple[float, ...]  # positive, ascending
    values: Curves  # NaN where not measured
    errors: Curves  # positive standard errors

    @property
    def measured(self) -> Bool[np.ndarray, "quantity strain"]:
        """Whether each value is measured."""
        return np.isfinite(self.values)

    def misfit(self, curves: Curves) -> Float[np.ndarray, " value"]:
        """Differences of curves from the measured values, in standard errors."""
        return ((curves - self.values) / self.errors)[self.measured]

    def chi_squared(self, curves: Curves) -> float:
        """χ² of curves."""
        return float(self.misfit(curves) @ self.misfit(curves))

    def root_mean_square(self, curves: Curves) -> dict[str, float]:
        """Root mean square difference of curves from the measured ones, in their units."""
        difference = np.where(self.measured, curves - self.values, 0.0)
        mean_square = (difference**2).sum(axis=1) / self.measured.sum(axis=1).clip(1)
        return dict(zip(QUANTITIES, np.sqrt(mean_square).tolist(), strict=True))


def measured_test(experiment: xr.Dataset, case: Case, model_error: float) -> MeasuredTest:
    """The measured curves of one test, scaled to the number of unit cells across a case."""
    cell = experiment.squeeze(drop=False)
    if CYCLE in cell.dims:
        raise invalid("fit", f"takes one cycle; select {CYCLE}=1")
    strains = cell["applied_strain"].values
    across = case.unit_cells[1] / cells_across(experiment)
    values, errors = np.full((2, len(QUANTITIES), len(strains)), np.nan)
    for row, name in enumerate(QUANTITIES):
        if name not in cell:
            continue
        scale = across if name == "reaction_force" else 1.0
        values[row], known = (scale * cell[each].values for each in (name, f"{name}_error"))
        # The error of the model is a fraction of the largest value of a curve.
        errors[row] = np.hypot(np.nan_to_num(known), model_error * np.nanmax(np.abs(values[row])))
    pulled = (strains > 0) & np.isfinite(values).any(axis=0)
    if pulled.sum() < MIN_STRAINS:
        message = f"needs at least {MIN_STRAINS} strains; import markers or the tensile test"
        raise invalid("fit", message)
    values, errors = values[:, pulled], errors[:, pulled]
    if not (errors[np.isfinite(values)] > 0).all():
        raise invalid("model_error 0", "leaves values without an error; give one above 0")
    errors = np.nan_to_num(errors, nan=NO_ERROR)
    return MeasuredTest(tuple(strains[pulled].tolist()), values, errors)


def case_for(plan: Plan, experiment: xr.Dataset) -> Case:
    """The one case of a plan with the design of an experiment; or InputError."""
    if not is_measured(experiment):
        raise invalid("fit", "needs an experiment, and this cube was simulated; import one")
    wanted = {dim: int(experiment[dim].values[0]) for dim in DESIGN_DIMS}
    cases = [case for case in plan.cases.values() if wanted.items() <= case.design.items()]
    if len(cases) != 1:
        hint = "one value of each setting" if cases else "n_stripe and n_subunit"
        design = tuple(wanted.values())
        message = f"must have one case of {design}, and has {len(cases)}; set {hint}"
        raise invalid(plan.workflow, message)
    (case,) = cases
    if case.method != "equilibrium":
        raise invalid(plan.workflow, "uses dynamics; set method = equilibrium")
    if int(experiment["status"].values.flat[0]) != Status.ok:
        raise invalid("fit", "needs an experiment that is ok, and this one is not; import it again")
    # A test that continues from another cannot keep clear of contact.
    options = replace(case.options, contact="none")
    return replace(case, options=options, capacitor=None, sensitivities=False, unloading=False)


@dataclass(frozen=True)
class SimulatedTest:
    """A converged test of a case."""

    case: Case
    unknowns: Float[np.ndarray, "state unknown"]  # of every state, the relaxed one first

    @property
    def configurations(self) -> list[Configuration]:
        """The shapes of the fabric."""
        return [Configuration.of(each, self.case.mesh_shape) for each in self.unknowns]

    @cached_property
    def values(self) -> Curves:
        """The curves of the test."""
        _, fabric = self.case.assemble()
        relaxed, *strained = (jax.tree.map(jnp.asarray, each) for each in self.configurations)
        untouched = jnp.zeros(self.case.mesh_shape.unknowns)
        return np.array([self._measure(relaxed, each, fabric, untouched) for each in strained]).T

    def slopes(self) -> Float[np.ndarray, "quantity strain parameter"]:
        """Derivatives by logarithms of stripe parameters; NoDerivative if a state is unstable."""
        (relaxed, *strained), stripes = self.configurations, self.case.stripe_pair
        adjoint = adjoint_of(self.case, relaxed)
        slopes = [
            logarithmic(adjoint.strained_derivatives(strain, state, self._measure), stripes)
            for strain, state in zip(self.case.applied_strain[1:], strained, strict=True)
        ]
        return np.stack(slopes, axis=1)

    @property
    def _measure(self) -> Quantity:
        return measured_by(self.case.mesh_shape, self.case.cell_grid, QUANTITIES)


def with_factors(case: Case, factors: Mapping[str, float]) -> Case:
    """A case with stripe parameters scaled by factors, by name of :data:`STRIPE_PARAMETERS`."""

    def scaled(stripe: Stripe) -> Stripe:
        by = {name: factors.get(f"{stripe.knit}_{name}", 1.0) for name in STRIPE_QUANTITIES}
        return replace(stripe, **{name: getattr(stripe, name) * by[name] for name in by})

    return case.with_stripes(scaled, scaled)


def simulated_test(case: Case, near: SimulatedTest | None = None) -> SimulatedTest | None:
    """A test from the states of ``near``, or from the flat sheet; None if it does not converge."""
    if near is None:
        (test,) = Equilibrium().stretch([case], lambda name, states: None)
        states = test.states
    else:
        _, fabric = case.assemble()
        (states,) = run_each(case.mesh_shape, [fabric], [partial(_continued, case=case, near=near)])
    if len(states) < len(case.applied_strain) or not all(state.converged for state in states):
        return None
    return SimulatedTest(case, np.array([state.unknowns for state in states]))


def _continued(system: System, case: Case, near: SimulatedTest) -> list[State]:
    settings = case.equilibrium_solver
    relaxed = relax(system, replace(settings, soft_wall=1.0), near.configurations[0])
    loading = loading_of(system.shape, relaxed.configuration)
    rules = SearchRules(free_stiffness(system.shape, loading.free), settings, convexified=False)
    states, first = [relaxed], near.unknowns[0]
    for strain, other in zip(case.applied_strain[1:], near.unknowns[1:], strict=True):
        if not states[-1].converged:
            break
        # The relaxed sample may have changed size: add the change of the relaxed shape.
        start = Point(loading.holding(other + relaxed.unknowns - first, strain))
        states.append(find_equilibrium(system, start, rules))
    return states
