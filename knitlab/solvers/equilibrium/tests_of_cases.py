"""How cases are tested by equilibria: what each starts from, and the progress of its states."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from knitlab.model.fabric import Configuration
from knitlab.solvers.equilibrium.equilibrium import run_cases
from knitlab.solvers.equilibrium.state import TensileTest
from knitlab.solvers.equilibrium.tensile_test import imperfect_sheet, relax, stretch, tiled
from knitlab.solvers.method import Progress

if TYPE_CHECKING:
    from knitlab.solvers.case import Case
    from knitlab.solvers.dynamics.damped_test import Relaxed

SECONDS_BETWEEN_REPORTS = 1.0
USUAL_FACTORISATIONS = 20  # of a state
Starts = Sequence[Configuration | None]


def stretched(
    cases: "Sequence[Case]", progress: Progress, imperfection: int | None = None
) -> list[TensileTest]:
    """Tests of the cases; from flat sheets, or from imperfect ones, by this seed."""
    starts = tilings(cases, imperfection)
    moved: Sequence[Relaxed | None] = [None] * len(cases)
    if cases[0].relaxes_by_dynamics:
        from knitlab.solvers.dynamics.method import moved_sheets  # few cases need the dynamics

        moved = moved_sheets(cases, progress, starts)
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
            factorised=reporter.factorised,
            load=case.load,
            friction=case.friction,
            cycle=case.cycle,
        )
        for case, start, relaxed, reporter in zip(cases, starts, moved, reporters, strict=True)
    ]
    return [
        test if relaxed is None else _after_motion(test, relaxed)
        for test, relaxed in zip(run_cases(cases, searches), moved, strict=True)
    ]


def _sheets(cases: "Sequence[Case]", imperfection: int | None) -> Starts:
    """Imperfect sheets of cases, by a seed, or None for flat ones."""
    if imperfection is None:
        return [None] * len(cases)
    return [imperfect_sheet(*case.assemble(), imperfection) for case in cases]


def tilings(cases: "Sequence[Case]", imperfection: int | None = None) -> Starts:
    """Sheets; of samples that start as a tiling of relaxed periodic fabric, that tiling [mm]."""
    starts = [*_sheets(cases, imperfection)]
    numbers = [
        number
        for number, case in enumerate(cases)
        if not case.mesh_shape.periodic and case.equilibrium_solver.start == "periodic"
    ]
    if not numbers:
        return starts
    cells = [cases[number].periodic_cell for number in numbers]
    searches = [
        partial(relax, settings=cell.equilibrium_solver, start=sheet)
        for cell, sheet in zip(cells, _sheets(cells, imperfection), strict=True)
    ]
    for number, cell, state in zip(numbers, cells, run_cases(cells, searches), strict=True):
        if not state.converged:
            continue
        tiling = tiled(*cases[number].assemble(), cell.layout.net, state.configuration)
        contact = cases[number].contact
        if contact is None or contact.holds(np.asarray(tiling.flattened())):
            starts[number] = tiling
    return starts


def _after_motion(test: TensileTest, relaxed: "Relaxed") -> TensileTest:
    """A test by equilibria of a fabric that relaxed by dynamics, with the history of that."""
    first, *others = test.states
    peak = float(relaxed.history.kinetic.max())
    first = replace(first, iterations=first.iterations + relaxed.steps, kinetic_peak=peak)
    return replace(test, states=[first, *others], history=relaxed.history)


class Reporter:
    """Reports finished states, plus n / (n + 20) of the next one after n factorisations."""

    def __init__(self, report: Callable[[float], None]) -> None:
        self._report = report
        self._states = 0
        self._factorisations = 0
        self._last = time.monotonic()

    def done(self, states: int) -> None:
        """Report a number of finished states."""
        self._states = states
        self._factorisations = 0
        self._report(states)

    def factorised(self) -> None:
        """Count a factorisation, and report the fraction at most once a second."""
        self._factorisations += 1
        if time.monotonic() - self._last >= SECONDS_BETWEEN_REPORTS:
            self._last = time.monotonic()
            fraction = self._factorisations / (self._factorisations + USUAL_FACTORISATIONS)
            self._report(self._states + fraction)
