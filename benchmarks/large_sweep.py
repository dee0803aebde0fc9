"""Benchmark of large sweeps: ``python -m benchmarks.large_sweep`` in the repository.

It plans a sweep of many small cases, runs it with a stand-in that writes case files of the real
shape in place of a simulation, and asks for its status, a query and its shards. It prints the
processor time of each step, user and system together, which other programs on the machine hardly
change, and wall time beside it. Nothing of it is a test: figures depend on the machine.
"""

import json
import resource
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from benchmarks.command_line import COMMAND, processor_seconds
from knitlab.cubes.case_file import write_case_file
from knitlab.cubes.cube_file import CUBE
from knitlab.runs.batches import Shard, split
from knitlab.runs.merge import merge_folders
from knitlab.runs.plan import make_plan
from knitlab.runs.results_folder import PLAN
from knitlab.runs.run import RunOptions, run_plan
from knitlab.runs.workers import Batch
from knitlab.solvers.method import Progress
from tests.runs.fake_simulator import contents

DESIGNS_OF_PREVIEW = 10
COLD_STARTS = 3
SHARDS = 40
OWN_FOLDERS = 4
"""Shards that are run into folders of their own and merged."""


class StandIn:
    """Simulates by making up the contents of case files, and adds up how long that takes [s]."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self, results: Path, cases: Batch, progress: Progress) -> None:
        """Write the case files of a batch."""
        for case in cases:
            began = time.process_time()
            dataset = contents(case)
            self.seconds += time.process_time() - began
            write_case_file(results, case.case_id, dataset)
            progress(case.case_id, case.states)


@click.command()
@click.option("--cases", default=10_000, show_default=True, help="Cases of the sweep.")
@click.option("--merge/--no-merge", default=True, help="Whether to merge folders of shards too.")
@click.option("--folder", type=click.Path(path_type=Path), help="Where to write; else temporary.")
def main(cases: int, merge: bool, folder: Path | None) -> None:
    """Time plan, run, cube, status, query, shards and merge of a sweep."""
    factors = max(1, cases // DESIGNS_OF_PREVIEW)
    values = ",".join(f"{1 + k / 100_000:g}" for k in range(factors))
    overrides = (f"k_t_factor={values}", "strain_max=0.06", "robustness=0")
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as temporary:
        results = Path(temporary)
        plan = timed("plan", lambda: make_plan("periodic", overrides))
        timed("  plan.json", lambda: plan.write(results / PLAN))
        timed(f"  split into {SHARDS} shards", lambda: split(plan.batches, plan.cases, SHARDS))

        fake_simulator = StandIn()
        options = RunOptions(simulate=fake_simulator)
        began = time.process_time()
        timed("run", lambda: run_plan(plan, results / "periodic", options))
        whole = time.process_time() - began
        say("  of it the stand-in, a case", 1e3 * fake_simulator.seconds / len(plan.cases), "ms")
        say("  overhead, a case", 1e3 * (whole - fake_simulator.seconds) / len(plan.cases), "ms")
        say("  cube", (results / "periodic" / CUBE).stat().st_size / 1e6, "MB")
        again = [word for setting in overrides for word in ("--set", setting)]
        for words in (
            ("run", "periodic", *again, "--results", str(results)),
            ("status", "periodic", "--results", str(results)),
            ("query", str(results / "periodic"), "--where", "poisson_ratio_min < -2"),
            ("query", str(results / "periodic"), "--select", "k_t_factor=1", "--sort", "periods"),
        ):
            cold(*words)
        if merge:
            for number in range(1, OWN_FOLDERS + 1):
                part = RunOptions(simulate=fake_simulator, shard=Shard(number, OWN_FOLDERS))
                run_plan(plan, results / f"shard-{number}" / "periodic", part)
            shards = sorted(results.glob("shard-*"))
            timed(f"merge of {OWN_FOLDERS} folders", lambda: merge_folders(shards, results / "all"))
        for of, who in (("", resource.RUSAGE_SELF), (" of commands", resource.RUSAGE_CHILDREN)):
            say(f"largest memory{of}", resource.getrusage(who).ru_maxrss / 1e6, "GB")


def timed(what: str, call: Callable[[], Any]) -> Any:
    """What a call returns; its processor time and wall time are printed [s]."""
    began, processor = time.perf_counter(), time.process_time()
    result = call()
    say(what, time.process_time() - processor, "s", wall=time.perf_counter() - began)
    return result


def cold(*words: str) -> None:
    """Print the least processor time of some runs of a command in a process of its own [s]."""
    found = []
    for _ in range(COLD_STARTS):
        before, began = processor_seconds(), time.perf_counter()
        subprocess.run([*COMMAND, *words], check=True, capture_output=True)
        wall = time.perf_counter() - began
        found.append((processor_seconds() - before, wall))
    used, wall = min(found)
    shown = " ".join(word for word in words if not word.startswith("/") and len(word) < 100)
    say(f"knitlab {shown.replace(' --results', '')}", used, "s", wall=wall)


def say(what: str, figure: float, unit: str, **more: float) -> None:
    """Print one figure as JSON, so that another program can read it."""
    rounded = {name: round(value, 3) for name, value in more.items()}
    click.echo(json.dumps({"what": what, "figure": round(figure, 3), "unit": unit, **rounded}))


if __name__ == "__main__":
    main()
