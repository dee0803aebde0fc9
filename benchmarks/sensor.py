"""Time for the capacitances of a finished sweep: ``python -m benchmarks.sensor RESULTS``.

It takes the shapes from the case files and computes every capacitance again, cold, by boundary
elements, as the sweep did. Nothing of it is a test: figures depend on the machine.
"""

import json
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import click
import numpy as np

from knitlab.cubes.case_file import configurations, read_case
from knitlab.runs.workers import WORKER_ENVIRONMENT


@click.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--steps", default=15, show_default=True, help="Strains of each case.")
@click.option("--workers", default=2, show_default=True, help="Processes, one thread each.")
def main(results: Path, steps: int, workers: int) -> None:
    """Time the capacitances of the cases in RESULTS, the folder of a workflow with electrodes."""
    # The largest first, so that no worker ends alone.
    files = sorted(results.glob("cases/*.nc"), key=lambda file: -file.stat().st_size)
    if not files:
        raise click.UsageError(f"{results} holds no case files; run a workflow there first")
    os.environ.update(WORKER_ENVIRONMENT)
    spawn = multiprocessing.get_context("spawn")
    began = time.perf_counter()
    with ProcessPoolExecutor(workers, mp_context=spawn) as pool:
        tasks = [pool.submit(capacitances_of, results, file.stem, steps) for file in files]
        found = [task.result() for task in tasks]
    wall = time.perf_counter() - began
    click.echo("case                      states  measured  largest error   seconds")
    for file, (states, measured, error, seconds) in zip(files, found, strict=True):
        click.echo(f"{file.stem:24}  {states:6}  {measured:8}  {error:13.2%}  {seconds:8.1f}")
    click.echo(f"{len(files)} cases by {workers} workers: {wall:.1f} s, imports and compiling too")


def capacitances_of(results: Path, case_id: str, steps: int) -> tuple[int, int, float, float]:
    """States of a case, those that were measured, their largest error, and the time taken [s]."""
    from knitlab.observables.capacitance.capacitor import capacitances
    from knitlab.observables.capacitance.sensor import CapacitorStatus
    from knitlab.solvers.case import case_of

    dataset = read_case(results, case_id)
    case = case_of(json.loads(dataset.attrs["parameters"]))
    if case.capacitor is None:
        raise click.UsageError(f"case {case_id} has no electrodes")
    states = configurations(dataset)
    stored = np.flatnonzero(np.isfinite(states.flattened()).all(axis=1))
    chosen = stored[np.linspace(0, len(stored) - 1, min(steps, len(stored))).round().astype(int)]
    began = time.perf_counter()
    found = capacitances(case.electrodes, *case.assemble(), states[chosen], case.capacitor)
    seconds = time.perf_counter() - began
    measured = found.status == CapacitorStatus.measured
    largest = float(np.max(found.error, where=measured, initial=0.0))
    return len(chosen), int(measured.sum()), largest, seconds


if __name__ == "__main__":
    main()
