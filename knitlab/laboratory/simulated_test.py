"""Simulated tests for a fit: repeated with changed stripes, with derivatives."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.equilibrium import find_equilibrium, run_each
from knitlab.equilibrium.loading import tensile
from knitlab.equilibrium.search import SearchRules
from knitlab.equilibrium.state import State, TensileTest
from knitlab.equilibrium.stiffness import free_stiffness
from knitlab.equilibrium.system import System
from knitlab.equilibrium.tensile_test import relax
from knitlab.fabric.energy import Point
from knitlab.fabric.stripe import Stripe
from knitlab.simulation.case import Case
from knitlab.simulation.sensitivity import STRIPE_PARAMETERS, adjoint_of, logarithmic, measured_by
from knitlab.simulation.simulate import tensile_tests

QUANTITIES = ("mean_strain_xx", "mean_strain_yy", "reaction_force")
"""Quantities measured in a test, in this order."""


@dataclass(frozen=True)
class SimulatedTest:
    """A converged test of a case; ``values`` are of :data:`QUANTITIES` at strains above 0."""

    case: Case
    test: TensileTest
    values: Float[np.ndarray, "quantity strain"]

    def slopes(self) -> Float[np.ndarray, "quantity strain parameter"]:
        """Derivatives by logarithms of stripe parameters; NoDerivative if a state is unstable."""
        case, (relaxed, *strained) = self.case, self.test.states
        adjoint = adjoint_of(case, relaxed.configuration)
        measure = measured_by(case.mesh_shape, case.cell_grid, QUANTITIES)
        slopes = [
            logarithmic(adjoint.of_strained(strain, state.configuration, measure), case.stripe_pair)
            for strain, state in zip(case.applied_strain[1:], strained, strict=True)
        ]
        return np.stack(slopes, axis=1)


def with_factors(case: Case, factors: Mapping[str, float]) -> Case:
    """A case with stripe parameters scaled by factors, by name of :data:`STRIPE_PARAMETERS`."""

    def scaled(side: str, stripe: Stripe) -> Stripe:
        numbers = {
            name: getattr(stripe, name) * factors[label]
            for label, (of, name) in STRIPE_PARAMETERS.items()
            if of == side and label in factors
        }
        return replace(stripe, **numbers)

    return case.with_stripes(partial(scaled, "weft"), partial(scaled, "warp"))


def simulated_test(case: Case, near: SimulatedTest | None = None) -> SimulatedTest | None:
    """Test a case; ``None`` if a state does not converge.

    The search for each state starts from that of ``near``, a test with almost the same stripes;
    without it the test starts from the flat sheet, as in a sweep.
    """
    _, fabric = case.assemble()
    if near is None:
        (test,) = tensile_tests([case], lambda name, states: None)
    else:
        search = partial(_retested, case=case, near=near)
        (test,) = run_each(case.mesh_shape, [fabric], [search])
    converged = test.loading is not None and all(state.converged for state in test.states)
    if not converged or len(test.states) < len(case.applied_strain):
        return None
    measure = measured_by(case.mesh_shape, case.cell_grid, QUANTITIES)
    relaxed, *strained = (jax.tree.map(jnp.asarray, state.configuration) for state in test.states)
    values = [measure(relaxed, state, fabric) for state in strained]
    return SimulatedTest(case, test, np.array(values).T)


def _retested(system: System, case: Case, near: SimulatedTest) -> TensileTest:
    settings = case.equilibrium_solver
    first, *others = near.test.states
    relaxed = relax(system, replace(settings, soft_wall=1.0), first.configuration)
    if not relaxed.converged:
        return TensileTest(None, [relaxed])
    loading = tensile(system.shape, relaxed.configuration)
    free = free_stiffness(system.shape, loading.free)
    rules = SearchRules(free, settings, convexified=False)
    states: list[State] = [relaxed]
    for strain, other in zip(case.applied_strain[1:], others, strict=True):
        # The relaxed sample may have changed size: add the change of the relaxed shape.
        moved = other.unknowns + relaxed.unknowns - first.unknowns
        start = Point(loading.holding(moved, strain))
        states.append(find_equilibrium(system, start, rules))
        if not states[-1].converged:
            break
    return TensileTest(loading, states)
