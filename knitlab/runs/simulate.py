"""Simulation of a batch, the task that a worker runs: its tensile tests, and their case files."""

import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import xarray as xr

from knitlab.cubes.case_file import write_case_file
from knitlab.io.progress import listening
from knitlab.io.provenance import provenance
from knitlab.model.computing import computing
from knitlab.observables.finished_test import FinishedTest
from knitlab.observables.measurement import measured
from knitlab.solvers.case import Case, by_test
from knitlab.solvers.method import Progress
from knitlab.solvers.methods import METHODS
from knitlab.solvers.perturbed_copies import perturbed_tests


@computing()
def simulate_batch(results: Path, cases: Sequence[Case], progress: Progress) -> None:
    """Simulate cases of one mesh shape together, and write their case files.

    Cases that differ in their electrodes alone share a test.
    """
    for case, dataset in _simulated(cases, progress):
        write_case_file(results, case.case_id, dataset)


@computing()
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
    tests = METHODS[first[0].method].stretch(first, report)
    copies = perturbed_tests(first, report)
    wall_seconds = time.perf_counter() - began
    for those, test, perturbed in zip(sharing.values(), tests, copies, strict=True):
        for case in those:

            def measuring(share: float, doing: str, case: Case = case) -> None:
                progress(case.case_id, case.states + share, doing)

            with listening(measuring):
                dataset = measured(FinishedTest(case, test, perturbed))
            dataset.attrs |= provenance() | {
                "title": f"knitlab case {case.case_id}",
                "parameters": json.dumps(case.record),
                "reason": METHODS[case.method].failure(case, test),
                "batch_wall_seconds": wall_seconds,
            }
            yield case, dataset
