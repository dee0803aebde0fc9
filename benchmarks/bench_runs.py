"""Times of whole runs: ``python -m pytest benchmarks/bench_runs.py``.

Each run is a process of its own, with its own folder of compiled programs, which is empty for a
cold run. The processor time of all its processes is in ``extra_info``.
"""

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks.command_line import COMMAND, processor_seconds
from knitlab.io.job_limits import ONE_THREAD

ONE_DESIGN = "--set n_stripe=4 --set n_subunit=16"
RUNS = {
    "one design": ONE_DESIGN,
    "ten designs": "",
    "without perturbed copies": "--set robustness=0",
    "with sensitivities": "--set robustness=0 --set sensitivities=true",
    "twenty designs": "--set set=paper --set robustness=0",
}


def run(words: str, folder: Path) -> None:
    """Run ``periodic`` with some settings."""
    own = {*ONE_THREAD, "JAX_COMPILATION_CACHE_DIR"}
    environment = {name: value for name, value in os.environ.items() if name not in own}
    command = [*COMMAND, "run", "periodic", *words.split(), "--results", str(folder / "results")]
    environment["XDG_CACHE_HOME"] = str(folder / "programs")
    subprocess.run(command, check=True, capture_output=True, env=environment)


@pytest.mark.parametrize("state", ["cold", "programs compiled", "nothing to do"])
@pytest.mark.parametrize("name", RUNS)
def test_run(benchmark: Any, name: str, state: str, tmp_path: Path) -> None:
    """A run of the command line, with its figures."""
    processor: list[float] = []

    def prepare() -> None:
        if state != "nothing to do":
            shutil.rmtree(tmp_path / "results", ignore_errors=True)
        if state == "cold":
            shutil.rmtree(tmp_path / "programs", ignore_errors=True)
        processor.append(processor_seconds())

    if state != "cold":
        run(RUNS[name], tmp_path)
    benchmark.pedantic(run, args=(RUNS[name], tmp_path), setup=prepare, rounds=3)
    mean = (processor_seconds() - processor[0]) / len(processor)
    benchmark.extra_info["processor seconds"] = mean
