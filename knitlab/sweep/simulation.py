"""Simulation of one batch: the task that a worker runs."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from knitlab.mechanics.lockstep import run_in_lockstep
from knitlab.mechanics.tension import TensileTest, stretch
from knitlab.model.fabric import weave
from knitlab.sweep.case_file import case_path
from knitlab.sweep.files import written_whole
from knitlab.sweep.measurement import measured
from knitlab.sweep.plan import Case
from knitlab.sweep.provenance import provenance
from knitlab.sweep.registry import encoding

Progress = Callable[[str, int], None]


def simulate_batch(results: Path, cases: Sequence[Case], progress: Progress) -> None:
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
    for case, test in zip(cases, finished, strict=True):
        write_case(results, case, test, wall_seconds)


def write_case(results: Path, case: Case, test: TensileTest, wall_seconds: float) -> None:
    """Measure a finished test, write its case file."""
    dataset = measured(case, test)
    dataset.attrs |= provenance() | {
        "title": f"knitlab case {case.case_id}",
        "parameters": json.dumps(asdict(case)),
        "reason": failure_reason(case, test),
        "batch_wall_seconds": wall_seconds,
    }
    with written_whole(case_path(results, case.case_id)) as temporary:
        dataset.to_netcdf(temporary, encoding=encoding(dataset))


def failure_reason(case: Case, test: TensileTest) -> str:
    """Why a test did not reach its last strain; empty if it did."""
    last = test.states[-1]
    if last.converged:
        return ""
    strain = case.applied_strain[len(test.states) - 1]
    return (
        f"no equilibrium at applied strain {strain:g}: {last.residual:.1e} N left after"
        f" {last.iterations} Newton steps ({last.outcome.name.replace('_', ' ')})"
    )
