"""Perturbed copies of a case: how far their results spread shows the effect of imperfections."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.model.stripe import STRIPE_QUANTITIES, Stripe
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.equilibrium import run_cases
from knitlab.solvers.equilibrium.method import Equilibrium
from knitlab.solvers.equilibrium.state import TensileTest
from knitlab.solvers.equilibrium.tensile_test import relax_near
from knitlab.solvers.method import Progress

STRIPE_TOLERANCE = 0.02  # largest relative change of a stripe parameter


@dataclass(frozen=True)
class PerturbedTest:
    """A copy, its test, and the energy of the original relaxed from its shape, or NaN [N mm]."""

    case: Case
    test: TensileTest
    branch_energy: float


def perturbed_copy(case: Case, number: int) -> Case:
    """A perturbed copy, from 1 on: stripes differ by up to 2 %, and the start of every second."""
    pair, second = divmod(number - 1, 2)
    changes = np.random.default_rng(pair).uniform(-1, 1, size=(2, len(STRIPE_QUANTITIES)))
    # The second of a pair differs the other way, so that a spread is not to one side by chance.
    rib, garter = 1 + STRIPE_TOLERANCE * (-changes if second else changes)
    solver = case.solver
    if case.options.boundary == "clamped" and number % 2 and case.method == "equilibrium":
        settings = case.equilibrium_solver
        solver = replace(settings, start="periodic" if settings.start == "flat" else "flat")
    scaled = case.with_stripes(partial(_scaled, factors=rib), partial(_scaled, factors=garter))
    plain_test = replace(scaled, sensitivities=False, unloading=False, capacitor=None, robustness=0)
    return replace(plain_test, solver=solver).without_unused()


def _scaled(stripe: Stripe, factors: Float[np.ndarray, " number"]) -> Stripe:
    numbers: dict[str, Any] = {
        name: float(getattr(stripe, name) * factor)
        for name, factor in zip(STRIPE_QUANTITIES, factors, strict=True)
    }
    # A rest angle next to flat must not pass it.
    numbers["theta_0"] = min(numbers["theta_0"], (np.pi + stripe.theta_0) / 2)
    return replace(stripe, **numbers)


def perturbed_tests(cases: Sequence[Case], progress: Progress) -> list[list[PerturbedTest]]:
    """Tests of the perturbed copies of cases of one mesh shape, each case's in order."""
    tests: dict[str, list[PerturbedTest]] = {case.case_id: [] for case in cases}

    def add_copies(number: int) -> None:
        originals = [case for case in cases if case.robustness >= number]
        copies = [perturbed_copy(case, number) for case in originals]
        original_of = {copy.case_id: case for copy, case in zip(copies, originals, strict=True)}

        def report(name: str, states: float) -> None:
            case = original_of[name]
            progress(case.case_id, number * len(case.applied_strain) + states)

        tested = Equilibrium().stretch(copies, report, imperfection=number)
        energies = _branch_energies(originals, tested)
        for case, copy, test, energy in zip(originals, copies, tested, energies, strict=True):
            tests[case.case_id].append(PerturbedTest(copy, test, energy))

    for number in range(1, max(case.robustness for case in cases) + 1):
        add_copies(number)
    return [tests[case.case_id] for case in cases]


def _branch_energies(cases: Sequence[Case], tests: Sequence[TensileTest]) -> list[float]:
    """Energies of cases, relaxed from the relaxed shapes of copies; NaN if not in equilibrium."""
    first = [test.states[0] for test in tests]
    searches = [
        partial(relax_near, settings=case.equilibrium_solver, start=shape.configuration)
        for case, shape in zip(cases, first, strict=True)
    ]
    return [
        float(state.energy.total) if state.converged and shape.converged else np.nan
        for state, shape in zip(run_cases(cases, searches), first, strict=True)
    ]
