"""Benchmark of the sweep's machinery: ``python -m benchmarks.sweeps`` in the repository.

It plans, runs (a stand-in that writes case files of the real shape), and queries a sweep, and says
how long each took. Nothing of it is a test: figures depend on the machine.
"""

import json
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from benchmarks.command_line import COMMAND
from knitlab.cube.cube_file import CUBE
from knitlab.sweep.plan import Plan, make_plan
from knitlab.sweep.run import RunOptions, run_plan
from tests.sweep.stand_in import simulate

DESIGNS_OF_PREVIEW = 10
LOOPED = 1000
COLD_STARTS = 3


@click.command()
@click.option("--cases", default=10_000, show_default=True, help="Cases of the sweep.")
def main(cases: int) -> None:
    """Time plan, scheduling, status and query of a sweep."""
    factors = max(1, cases // DESIGNS_OF_PREVIEW)
    values = ",".join(f"{1 + k / 10_000:g}" for k in range(factors))
    overrides = (f"k_t_factor={values}", "strain_max=0.06")
    with TemporaryDirectory() as temporary:
        results = Path(temporary)
        plan, planning = timed(lambda: make_plan("preview", overrides))
        say(f"plan of {len(plan.cases)} cases", planning, "s")

        loop = looped(plan, results / "loop")
        say("bare loop, a case", 1e3 * loop, "ms")
        for workers in (0, 1, 2):
            folder = results / f"run-{workers}" / "preview"
            each, all_of_it, cube = scheduled(plan, folder, workers)
            say(f"run by {workers} workers", all_of_it, "s")
            say("  its cube, a case", 1e3 * cube, "ms")
            say("  scheduling, a case", 1e3 * (each - cube - loop / max(workers, 1)), "ms")
        again, second = timed(
            lambda: run_plan(plan, results / "run-0" / "preview", RunOptions(simulate=simulate))
        )
        say(f"run again, {len(again.simulated)} to do", second, "s")
        sweep = results / "run-0"
        for words in (
            ("status", "preview", "--results", str(sweep)),
            ("query", str(sweep / "preview"), "--where", "poisson_ratio_min < -2"),
            ("query", str(sweep / "preview"), "--select", "k_t_factor=1", "--sort", "periods"),
        ):
            say(f"knitlab {words[0]} {' '.join(words[2:])}"[:60], cold_start(*words), "s")


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and how long it took [s]."""
    began = time.perf_counter()
    return call(), time.perf_counter() - began


def looped(plan: Plan, results: Path) -> float:
    """Time for a case in a bare loop [s]."""
    chosen = list(plan.cases.values())[:LOOPED]
    _, seconds = timed(lambda: [simulate(results, [case], lambda *_: None) for case in chosen])
    return seconds / len(chosen)


def scheduled(plan: Plan, results: Path, workers: int) -> tuple[float, float, float]:
    """Time for a case in a run, its start apart; for the whole run; for a case in its cube [s]."""
    options = RunOptions(workers=workers, simulate=simulate)
    small = make_plan("preview", ("n_stripe=4", "strain_max=0.06"))
    _, start = timed(lambda: run_plan(small, results / "start", options))
    _, seconds = timed(lambda: run_plan(plan, results, options))
    (results / CUBE).unlink()
    _, cube = timed(lambda: run_plan(plan, results, options))
    return (seconds - start) / len(plan.cases), seconds, cube / len(plan.cases)


def cold_start(*words: str) -> float:
    """Best of some runs of a command in a process of its own [s]."""

    def once() -> None:
        subprocess.run([*COMMAND, *words], check=True, capture_output=True)

    return min(timed(once)[1] for _ in range(COLD_STARTS))


def say(what: str, figure: float, unit: str) -> None:
    """Print one figure as JSON, so that another program can read it."""
    click.echo(json.dumps({"what": what, "figure": round(figure, 4), "unit": unit}))


if __name__ == "__main__":
    main()
