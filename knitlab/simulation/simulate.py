"""Simulation of one batch, the task that a worker runs, and of one case."""

import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import xarray as xr

from knitlab.cube.case_file import write_case_file
from knitlab.equilibrium.state import Outcome, TensileTest
from knitlab.fabric.zigzag import zigzag
from knitlab.io.provenance import provenance
from knitlab.measure.zigzag_tension import pull_chain
from knitlab.simulation.case import Case, by_test
from knitlab.simulation.measurement import measured
from knitlab.simulation.tensile_tests import Progress, sibling_tests, tensile_tests

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
    chains = [
        pull_chain(zigzag(case.weft, case.options), case.periods, case.applied_strain)
        if case.pure
        else []
        for case in first
    ]
    wall_seconds = time.perf_counter() - began
    for those, test, chain, its in zip(sharing.values(), tests, chains, siblings, strict=True):
        for case in those:
            dataset = measured(case, test, chain, its)
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
    return (
        f"no {state} at applied strain {strain:g}: {last.residual:.1e} N left after"
        f" {last.iterations} {steps} ({WHY[last.outcome]})"
    )
