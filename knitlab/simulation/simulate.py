"""Simulation of one batch: the task that a worker runs."""

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from knitlab.cube.case_file import write_case_file
from knitlab.equilibrium.relaxation import imperfect_sheet, relax_near, starts_from_periodic
from knitlab.equilibrium.state import Outcome, TensileTest
from knitlab.equilibrium.system import run_each
from knitlab.equilibrium.tensile_test import stretch
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import Network
from knitlab.fabric.zigzag import zigzag
from knitlab.io.provenance import provenance
from knitlab.measure.zigzag_tension import ChainState, pull_chain
from knitlab.simulation.case import Case, by_test
from knitlab.simulation.contact_of_case import contact_of
from knitlab.simulation.measurement import measured
from knitlab.simulation.reporting import Progress, Reporter
from knitlab.simulation.robustness import SiblingTest, sibling

if TYPE_CHECKING:
    from knitlab.dynamics.damped_test import MovingFabrics, Relaxed


def simulate_batch(results: Path, cases: Sequence[Case], progress: Progress) -> None:
    """Relax and stretch the fabrics of one mesh shape together, and write their case files.

    Cases that differ in their electrodes alone share a test.

    Args:
        results: results folder of the workflow.
        cases: cases of one mesh shape.
        progress: called with a case's identifier and how many of its states are done.
    """
    began = time.perf_counter()
    sharing = by_test((case, case) for case in cases)
    first = [those[0] for those in sharing]
    of_all = partial(_progress_of_all, progress, {those[0].case_id: those for those in sharing})
    tests = tensile_tests(first, of_all)
    siblings = sibling_tests(first, of_all)
    chains = [_zigzag_test(case) if case.pure else [] for case in first]
    wall_seconds = time.perf_counter() - began
    for those, test, chain, its in zip(sharing, tests, chains, siblings, strict=True):
        for case in those:
            dataset = case_dataset(case, test, chain, its, wall_seconds)
            write_case_file(results, case.case_id, dataset)


def _progress_of_all(
    progress: Progress, sharing: dict[str, list[Case]], case_id: str, states: float
) -> None:
    for case in sharing[case_id]:
        progress(case.case_id, states)


def sibling_tests(cases: Sequence[Case], progress: Progress) -> list[list[SiblingTest]]:
    """Tests of the siblings of cases of one mesh shape, each case's in order."""
    tests: list[list[SiblingTest]] = [[] for _ in cases]
    for number in range(1, max(case.robustness for case in cases) + 1):
        places = [place for place, case in enumerate(cases) if case.robustness >= number]
        originals = [cases[place] for place in places]
        siblings = [sibling(case, number) for case in originals]
        names = {its.case_id: case for its, case in zip(siblings, originals, strict=True)}
        done = partial(_progress_of_sibling, progress, names, number)
        found = tensile_tests(siblings, done, imperfection=number)
        energies = branch_energies(originals, found)
        for place, case, test, energy in zip(places, siblings, found, energies, strict=True):
            tests[place].append(SiblingTest(case, test, energy))
    return tests


def _progress_of_sibling(
    progress: Progress, cases: dict[str, Case], number: int, sibling_id: str, states: float
) -> None:
    case = cases[sibling_id]
    progress(case.case_id, number * len(case.applied_strain) + states)


def branch_energies(cases: Sequence[Case], tests: Sequence[TensileTest]) -> list[float]:
    """Energies of cases, relaxed from the relaxed shapes of siblings; NaN if not in equilibrium.

    Args:
        cases: cases of one mesh shape.
        tests: a sibling's test of each.
    """
    assembled = [case.assemble() for case in cases]
    relaxed = run_each(
        cases[0].mesh_shape,
        [fabric for _, fabric in assembled],
        [
            partial(
                relax_near,
                settings=case.equilibrium_solver,
                start=test.states[0].configuration,
                contact=contact_of(case, its[1]),
            )
            for case, its, test in zip(cases, assembled, tests, strict=True)
        ],
    )
    return [
        float(state.energy.total) if state.converged and test.states[0].converged else np.nan
        for state, test in zip(relaxed, tests, strict=True)
    ]


def tensile_tests(
    cases: Sequence[Case],
    progress: Progress,
    imperfection: int | None = None,
) -> list[TensileTest]:
    """Tensile tests of cases of one mesh shape and method.

    Args:
        cases: the cases.
        progress: called with a case's identifier and how many of its states are done.
        imperfection: seed of the imperfections that they start from, if any; then the tests are
            by equilibria, whatever the method.
    """
    if cases[0].method == "dynamics" and imperfection is None:
        return dynamic_tests(cases, progress)
    assembled = [case.assemble() for case in cases]
    found = starts(cases, assembled, imperfection)
    moved = relaxed_by_dynamics(cases, found, progress)
    fabrics = [fabric for _, fabric in assembled]
    reporters = [Reporter(partial(progress, case.case_id)) for case in cases]
    tests = [
        partial(
            stretch,
            applied_strain=case.applied_strain,
            settings=case.equilibrium_solver,
            progress=reporter.done,
            start=start,
            folded=None if relaxed is None else relaxed.configuration,
            unload=case.unloading,
            contact=contact_of(case, fabric),
            factorised=reporter.factorised,
        )
        for case, fabric, reporter, start, relaxed in zip(
            cases, fabrics, reporters, found, moved, strict=True
        )
    ]
    ran = run_each(cases[0].mesh_shape, fabrics, tests)
    return [
        test if relaxed is None else after_motion(test, relaxed)
        for test, relaxed in zip(ran, moved, strict=True)
    ]


def relaxed_by_dynamics(
    cases: Sequence[Case], sheets: Sequence[Configuration | None], progress: Progress
) -> "list[Relaxed | None]":
    """What samples of one mesh shape relax to by dynamics; ``None`` for all others.

    Args:
        cases: the cases.
        sheets: what each relaxes from; ``None`` for the flat sheet [mm].
        progress: called with a case's identifier and which part of its relaxation is done.
    """
    found: list[Relaxed | None] = [None] * len(cases)
    places = [place for place, case in enumerate(cases) if case.relaxes_by_dynamics]
    if not places:
        return found
    from knitlab.dynamics.damped_test import relax_by_dynamics

    relaxed = relax_by_dynamics(
        moving_fabrics([cases[place] for place in places]),
        lambda number, part: progress(cases[places[number]].case_id, part),
        [sheets[place] for place in places],
    )
    for place, its in zip(places, relaxed, strict=True):
        found[place] = its
    return found


def after_motion(test: TensileTest, relaxed: "Relaxed") -> TensileTest:
    """A test by equilibria of a fabric that relaxed by dynamics, with the history of that."""
    first, *others = test.states
    peak = float(relaxed.history.kinetic.max())
    first = replace(first, iterations=first.iterations + relaxed.steps, kinetic_peak=peak)
    return replace(test, states=[first, *others], history=relaxed.history)


def starts(
    cases: Sequence[Case],
    assembled: Sequence[tuple[Network, Fabric]],
    imperfection: int | None = None,
) -> list[Configuration | None]:
    """What samples of one mesh shape relax from; ``None`` for the flat sheet [mm].

    Args:
        cases: the samples.
        assembled: network and fabric of each.
        imperfection: seed of the imperfections of all flat sheets, if any.
    """
    found: list[Configuration | None] = [None] * len(cases)
    if imperfection is not None:
        found = [imperfect_sheet(*its, imperfection) for its in assembled]
    tiled_places = [
        place
        for place, case in enumerate(cases)
        if not case.mesh_shape.periodic and case.equilibrium_solver.start == "periodic"
    ]
    if not tiled_places:
        return found
    cells = [cases[place].periodic_cell for place in tiled_places]
    assembled_cells = [cell.assemble() for cell in cells]
    fabrics = [fabric for _, fabric in assembled_cells]
    tiled = starts_from_periodic(
        [assembled[place] for place in tiled_places],
        assembled_cells,
        [cell.equilibrium_solver for cell in cells],
        imperfection,
        [contact_of(*its) for its in zip(cells, fabrics, strict=True)],
    )
    for place, start in zip(tiled_places, tiled, strict=True):
        if start is None:
            continue
        contact = contact_of(cases[place], assembled[place][1])
        if contact is None or contact.holds(np.asarray(start.flattened())):
            found[place] = start
    return found


def dynamic_tests(cases: Sequence[Case], progress: Progress) -> list[TensileTest]:
    """Tensile tests by damped dynamics, all cases in one vmapped program."""
    from knitlab.dynamics.damped_test import stretch_by_dynamics

    return stretch_by_dynamics(
        moving_fabrics(cases),
        [case.applied_strain for case in cases],
        lambda place, done: progress(cases[place].case_id, done),
    )


def moving_fabrics(cases: Sequence[Case]) -> "MovingFabrics":
    """Cases of one mesh shape and the same settings of the dynamics, as a batch."""
    from knitlab.dynamics.damped_test import MovingFabrics

    return MovingFabrics(
        cases[0].mesh_shape,
        [case.assemble()[1] for case in cases],
        [case.inertia() for case in cases],
        cases[0].motion,
    )


def _zigzag_test(case: Case) -> list[ChainState]:
    return pull_chain(zigzag(case.weft, case.options), case.periods, case.applied_strain)


def simulated(case: Case, progress: Progress) -> xr.Dataset:
    """Relax and stretch one case in this process.

    Args:
        case: the case.
        progress: called with how many of its states are done.

    Returns:
        What its case file would hold.
    """
    began = time.perf_counter()
    (test,), (siblings,) = tensile_tests([case], progress), sibling_tests([case], progress)
    chain = _zigzag_test(case) if case.pure else []
    return case_dataset(case, test, chain, siblings, time.perf_counter() - began)


def case_dataset(
    case: Case,
    test: TensileTest,
    chain: Sequence[ChainState],
    siblings: Sequence[SiblingTest],
    wall_seconds: float,
) -> xr.Dataset:
    """Measure a finished test; the dataset is what its case file holds."""
    dataset = measured(case, test, chain, siblings)
    dataset.attrs |= provenance() | {
        "title": f"knitlab case {case.case_id}",
        "parameters": json.dumps(case.record),
        "reason": failure_reason(case, test),
        "batch_wall_seconds": wall_seconds,
    }
    return dataset


WHY = {
    Outcome.iteration_limit: "the limit of steps was reached",
    Outcome.stalled: "no smaller step helped",
    Outcome.time_limit: "it was still moving at the end of its time; raise longest_time",
    Outcome.diverged: "it became unstable; lower step_safety",
}


def failure_reason(case: Case, test: TensileTest) -> str:
    """Why a test did not reach its last strain; empty if it did."""
    last = test.states[-1]
    if last.converged:
        return ""
    strain = case.applied_strain[len(test.states) - 1]
    dynamics = case.method == "dynamics"
    state, steps = ("state", "time steps") if dynamics else ("equilibrium", "steps")
    return (
        f"no {state} at applied strain {strain:g}: {last.residual:.1e} N left after"
        f" {last.iterations} {steps} ({WHY[last.outcome]})"
    )
