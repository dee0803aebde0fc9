"""Simulation of one batch: the task that a worker runs."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from knitlab.mechanics.lockstep import run_in_lockstep
from knitlab.mechanics.tension import stretch
from knitlab.model.fabric import weave
from knitlab.sweep.case_file import write_case
from knitlab.sweep.plan import Case
from knitlab.sweep.registry import Status

Progress = Callable[[str, int], None]


@dataclass(frozen=True)
class CaseResult:
    """What a worker reports of a case whose numbers are in its file."""

    case_id: str
    status: Status


def simulate_batch(results: Path, cases: Sequence[Case], progress: Progress) -> list[CaseResult]:
    """Relax and stretch the fabrics of one mesh shape in lockstep, and write their case files.

    Args:
        results: results folder of the workflow.
        cases: cases of one mesh shape.
        progress: told, for a case, how many of its states are done.
    """
    began = time.perf_counter()
    shape = cases[0].mesh_shape
    fabrics, tests = [], []
    for case in cases:
        net, fabric = weave(case.sample, case.rib, case.garter, case.sheet, case.reading)
        done = partial(progress, case.case_id)
        fabrics.append(fabric)
        tests.append(stretch(net, fabric, case.applied_strain, case.solver, done))
    finished = run_in_lockstep(shape, fabrics, tests)
    wall_seconds = time.perf_counter() - began
    return [
        CaseResult(case.case_id, write_case(results, case, test, wall_seconds))
        for case, test in zip(cases, finished, strict=True)
    ]
