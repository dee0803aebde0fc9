"""Simulation of a batch, the task that a worker runs: its tensile tests, and their case files.

Tests of cases of one mesh shape and of their siblings are by equilibria or by dynamics.
"""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import write_case_file
from knitlab.io.provenance import provenance
from knitlab.model.fabric import Configuration
from knitlab.model.zigzag import zigzag
from knitlab.observables.measurement import measured
from knitlab.solvers.case import Case, by_test
from knitlab.solvers.contact import contact_of
from knitlab.solvers.dynamics.contact_pairs import PairFinder
from knitlab.solvers.dynamics.damped_test import (
    MovingFabrics,
    Relaxed,
    relax_by_dynamics,
    stretch_by_dynamics,
)
from knitlab.solvers.equilibrium.equilibrium import run_each
from knitlab.solvers.equilibrium.state import Outcome, TensileTest
from knitlab.solvers.equilibrium.tensile_test import (
    imperfect_sheet,
    relax,
    relax_near,
    stretch,
    tiled,
)
from knitlab.solvers.siblings import SiblingTest, sibling
from knitlab.solvers.zigzag_tension import pull_chain

Progress = Callable[[str, float], None]
"""Function of a case's identifier and of the number of its finished states, with a fraction."""
SECONDS_BETWEEN_REPORTS = 1.0
USUAL_FACTORISATIONS = 20
WHY = {
    Outcome.iteration_limit: "the limit of steps was reached",
    Outcome.stalled: "no smaller step helped",
    Outcome.time_limit: "it was still moving at the end of its time; raise longest_time",
    Outcome.diverged: "it became unstable; lower step_safety",
}


def simulate_batch(results: Path, cases: Sequence[Case], progress: Progress) -> None:
    """Relax and stretch the fabrics of one mesh shape together, and write their case files.

    Cases that differ in their electrodes alone share a test. ``progress`` is called with a case's
    identifier and how many of its states are done.
    """
    for case, dataset in _simulated(cases, progress):
        write_case_file(results, case.case_id, dataset)


def simulated(case: Case, progress: Progress) -> xr.Dataset:
    """What the case file of a case would hold, simulated in this process."""
    ((_, dataset),) = _simulated([case], progress)
    return dataset


def _simulated(cases: Sequence[Case], progress: Progress) -> Iterator[tuple[Case, xr.Dataset]]:
    began = time.perf_counter()
    sharing = {those[0].case_id: those for those in by_test((case, case) for case in cases)}

    def report(case_id: str, states: float) -> None:
        for case in sharing[case_id]:
            progress(case.case_id, states)

    first = [those[0] for those in sharing.values()]
    tests, siblings = tensile_tests(first, report), sibling_tests(first, report)
    wall_seconds = time.perf_counter() - began
    for those, test, of_siblings in zip(sharing.values(), tests, siblings, strict=True):
        case, chain = those[0], []
        if case.pure:
            stripe = zigzag(case.weft, case.options)
            chain = pull_chain(stripe, case.periods, case.applied_strain)
        for case in those:
            dataset = measured(case, test, chain, of_siblings)
            dataset.attrs |= provenance() | {
                "title": f"knitlab case {case.case_id}",
                "parameters": json.dumps(case.record),
                "reason": failure_reason(case, test),
                "batch_wall_seconds": wall_seconds,
            }
            yield case, dataset


def failure_reason(case: Case, test: TensileTest) -> str:
    """Why a test did not reach its last strain; empty if it did."""
    last = test.states[-1]
    if last.converged:
        return ""
    strain = case.applied_strain[len(test.states) - 1]
    by_dynamics = case.method == "dynamics"
    state, steps = ("state", "time steps") if by_dynamics else ("equilibrium", "steps")
    at = f"at applied strain {strain:g}"
    if case.cycle > 1 and test.loading is None:
        at = f"before cycle {case.cycle}"
    return (
        f"no {state} {at}: {last.residual:.1e} N left after"
        f" {last.iterations} {steps} ({WHY[last.outcome]})"
    )


def tensile_tests(
    cases: Sequence[Case], progress: Progress, imperfection: int | None = None
) -> list[TensileTest]:
    """Tensile tests of cases of one mesh shape and method.

    From imperfections, by this seed, they are by equilibria whatever the method.
    """

    def report(number: int, states: float) -> None:
        progress(cases[number].case_id, states)

    if cases[0].method == "dynamics" and imperfection is None:
        strains = [case.applied_strain for case in cases]
        return stretch_by_dynamics(moving_fabrics(cases), strains, report)
    sheets = starts(cases, imperfection)
    moved: list[Relaxed | None] = [None] * len(cases)
    if cases[0].relaxes_by_dynamics:
        moved = [*relax_by_dynamics(moving_fabrics(cases), report, sheets)]
    reporters = [Reporter(partial(progress, case.case_id)) for case in cases]
    searches = [
        partial(
            stretch,
            applied_strain=case.applied_strain,
            settings=case.equilibrium_solver,
            progress=reporter.done,
            start=start,
            folded=None if relaxed is None else relaxed.configuration,
            unload=case.unloading,
            contact=contact_of(case),
            factorised=reporter.factorised,
            load=case.load,
            friction=case.friction,
            cycle=case.cycle,
        )
        for case, start, relaxed, reporter in zip(cases, sheets, moved, reporters, strict=True)
    ]
    fabrics = [case.assemble()[1] for case in cases]
    tests = run_each(cases[0].mesh_shape, fabrics, searches)
    return [
        test if relaxed is None else _after_motion(test, relaxed)
        for test, relaxed in zip(tests, moved, strict=True)
    ]


def _after_motion(test: TensileTest, relaxed: Relaxed) -> TensileTest:
    """A test by equilibria of a fabric that relaxed by dynamics, with the history of that."""
    first, *others = test.states
    peak = float(relaxed.history.kinetic.max())
    first = replace(first, iterations=first.iterations + relaxed.steps, kinetic_peak=peak)
    return replace(test, states=[first, *others], history=relaxed.history)


class Reporter:
    """Reports finished states, plus n / (n + 20) of the next one after n factorisations."""

    def __init__(self, report: Callable[[float], None]) -> None:
        self._report = report
        self._states = self._factorisations = 0
        self._last = time.monotonic()

    def done(self, states: int) -> None:
        """Report a number of finished states."""
        self._states, self._factorisations = states, 0
        self._report(states)

    def factorised(self) -> None:
        """Count a factorisation, and report the fraction at most once a second."""
        self._factorisations += 1
        if time.monotonic() - self._last >= SECONDS_BETWEEN_REPORTS:
            self._last = time.monotonic()
            fraction = self._factorisations / (self._factorisations + USUAL_FACTORISATIONS)
            self._report(self._states + fraction)


def starts(cases: Sequence[Case], imperfection: int | None = None) -> list[Configuration | None]:
    """What samples relax from: the flat sheet (``None``), an imperfect one, or a tiling [mm]."""
    shapes: list[Configuration | None] = [None] * len(cases)
    if imperfection is not None:
        shapes = [imperfect_sheet(*case.assemble(), imperfection) for case in cases]
    cells = {
        number: case.periodic_cell
        for number, case in enumerate(cases)
        if not case.mesh_shape.periodic and case.equilibrium_solver.start == "periodic"
    }
    if not cells:
        return shapes
    fabrics = [cell.assemble() for cell in cells.values()]
    searches = [
        partial(
            relax,
            settings=cell.equilibrium_solver,
            start=None if imperfection is None else imperfect_sheet(*fabric, imperfection),
            contact=contact_of(cell),
        )
        for cell, fabric in zip(cells.values(), fabrics, strict=True)
    ]
    relaxed = run_each(fabrics[0][0].shape, [fabric for _, fabric in fabrics], searches)
    for number, (net, _), state in zip(cells, fabrics, relaxed, strict=True):
        if state.converged:
            tiling = tiled(*cases[number].assemble(), net, state.configuration)
            contact = contact_of(cases[number])
            if contact is None or contact.holds(np.asarray(tiling.flattened())):
                shapes[number] = tiling
    return shapes


def moving_fabrics(cases: Sequence[Case]) -> MovingFabrics:
    """Cases of one mesh shape and the same settings of the dynamics, as a batch."""
    fabrics, inertias = [case.assemble()[1] for case in cases], [case.inertia() for case in cases]
    loads, shape = [case.load for case in cases], cases[0].mesh_shape
    finders = [
        PairFinder(shape, case.contact_layers) for case in cases if case.options.contact != "none"
    ]
    return MovingFabrics(shape, fabrics, inertias, cases[0].motion, loads, finders)


def sibling_tests(cases: Sequence[Case], progress: Progress) -> list[list[SiblingTest]]:
    """Tests of the siblings of cases of one mesh shape, each case's in order."""
    tests: dict[str, list[SiblingTest]] = {case.case_id: [] for case in cases}
    for number in range(1, max(case.robustness for case in cases) + 1):
        originals = [case for case in cases if case.robustness >= number]
        siblings = [sibling(case, number) for case in originals]
        by_id = {varied.case_id: case for varied, case in zip(siblings, originals, strict=True)}

        def report(name: str, states: float, by_id: Any = by_id, before: int = number) -> None:
            progress(by_id[name].case_id, before * len(by_id[name].applied_strain) + states)

        tested = tensile_tests(siblings, report, imperfection=number)
        energies = _branch_energies(originals, tested)
        for case, varied, test, energy in zip(originals, siblings, tested, energies, strict=True):
            tests[case.case_id].append(SiblingTest(varied, test, energy))
    return [tests[case.case_id] for case in cases]


def _branch_energies(cases: Sequence[Case], tests: Sequence[TensileTest]) -> list[float]:
    """Energies of cases, relaxed from the relaxed shapes of siblings; NaN if not in equilibrium."""
    searches = [
        partial(
            relax_near,
            settings=case.equilibrium_solver,
            start=test.states[0].configuration,
            contact=contact_of(case),
        )
        for case, test in zip(cases, tests, strict=True)
    ]
    relaxed = run_each(cases[0].mesh_shape, [case.assemble()[1] for case in cases], searches)
    return [
        float(state.energy.total) if state.converged and test.states[0].converged else np.nan
        for state, test in zip(relaxed, tests, strict=True)
    ]
