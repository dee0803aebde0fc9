"""Time of whole runs: ``python -m benchmarks.runs`` in the repository.

Each run of the command line is a process of its own, with a cache folder for compiled programs that
is empty for a cold run. All runs are measured in turn, several times, so that a machine whose speed
changes affects all alike. The cube holds every repeat; a second call resumes the first. Nothing of
it is a test: figures depend on the machine.
"""

import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
import xarray as xr

from benchmarks.command_line import COMMAND, processor_seconds, results_in
from benchmarks.solver.cube import machine, write_cube
from knitlab.cubes.cube_file import CUBE
from knitlab.io.provenance import provenance
from knitlab.model.threads import ONE_THREAD

FILE = "runs.nc"
WORKFLOW = "periodic"
ONE_DESIGN = ("--set", "n_stripe=4", "--set", "n_subunit=16")
PAPER = ("--set", "set=paper")
ALONE = ("--set", "robustness=0")
VARIABLES = {
    "seconds": "wall time of the command, with its figures",
    "seconds_until_cube": "wall time until the cube was written; missing if it was not",
    "processor_seconds": "processor time of all its processes, user and system",
}


@dataclass(frozen=True)
class TimedRun:
    """A command to be timed.

    Attributes:
        words: arguments of ``knitlab run periodic``.
        cold: whether programs must be compiled.
        again: whether to time a second run into the same folder, which has nothing to do.
    """

    words: tuple[str, ...] = ()
    cold: bool = False
    again: bool = False


RUNS = {
    "one design, cold": TimedRun(ONE_DESIGN, cold=True),
    "one design": TimedRun(ONE_DESIGN),
    "nothing to do": TimedRun(ONE_DESIGN, again=True),
    "ten designs, cold": TimedRun(cold=True),
    "ten designs": TimedRun(),
    "ten designs without siblings": TimedRun(ALONE),
    "ten designs without siblings, with sensitivities": TimedRun(
        (*ALONE, "--set", "sensitivities=true")
    ),
    "paper's 20 designs without siblings": TimedRun((*PAPER, *ALONE)),
}


@click.command()
@click.option("--repeats", default=3, show_default=True, help="Repeats of every run.")
@click.option("--only", multiple=True, type=click.Choice(list(RUNS)), help="Only these runs.")
@results_in("run_benchmark")
def main(repeats: int, only: tuple[str, ...], results: Path) -> None:
    """Time whole runs and print the median of their repeats, with the range."""
    path = results / FILE
    cube = _kept(path, repeats)
    with TemporaryDirectory() as temporary:
        folder, compiled = Path(temporary), set[TimedRun]()
        for repeat in range(repeats):
            for name in only or RUNS:
                if cube["seconds"].sel(run=name, repeat=repeat).isnull():
                    for variable, value in _measured(RUNS[name], folder, compiled).items():
                        cube[variable].loc[{"run": name, "repeat": repeat}] = value
                    write_cube(cube, path)
    for name in only or RUNS:
        of_run = cube.sel(run=name)
        shown = "  ".join(_spread(of_run[variable]) for variable in VARIABLES)
        click.echo(f"{name:45} {shown}")


def _kept(path: Path, repeats: int) -> xr.Dataset:
    """The cube with every measurement so far, and room for all others."""
    empty = np.full((len(RUNS), repeats), np.nan)
    cube = xr.Dataset(
        {
            name: (("run", "repeat"), empty.copy(), {"units": "s", "long_name": text})
            for name, text in VARIABLES.items()
        },
        {"run": list(RUNS), "repeat": range(repeats)},
        {**provenance(), **machine()},
    )
    if not path.exists():
        return cube
    with xr.open_dataset(path) as kept:
        if kept.attrs["git_commit"] != cube.attrs["git_commit"]:
            raise click.UsageError(f"{path} is of another commit; remove it to measure this one")
        return kept.load().reindex(run=list(RUNS), repeat=range(repeats)).assign_attrs(kept.attrs)


def _measured(run: TimedRun, folder: Path, compiled: set[TimedRun]) -> dict[str, float]:
    """Time a run, after one that compiles its programs or has computed its cases already.

    Args:
        run: the run.
        folder: where to write.
        compiled: the runs whose programs are compiled, to which it is added.
    """
    results, programs = folder / "results", folder / ("no-programs" if run.cold else "programs")
    shutil.rmtree(results, ignore_errors=True)
    if run.cold:
        shutil.rmtree(programs, ignore_errors=True)
    elif run.again or run not in compiled:
        _call(run, results, programs)
        compiled.add(run)
    if not run.again:
        shutil.rmtree(results, ignore_errors=True)
    began, before = time.time(), processor_seconds()
    _call(run, results, programs)
    ended = time.time()
    written = (results / WORKFLOW / CUBE).stat().st_mtime
    return {
        "seconds": ended - began,
        "seconds_until_cube": written - began if written > began else np.nan,
        "processor_seconds": processor_seconds() - before,
    }


def _call(run: TimedRun, results: Path, programs: Path) -> None:
    own = {*ONE_THREAD, "JAX_COMPILATION_CACHE_DIR"}
    environment = {name: value for name, value in os.environ.items() if name not in own}
    subprocess.run(
        [*COMMAND, "run", WORKFLOW, *run.words, "--results", str(results)],
        check=True,
        capture_output=True,
        env=environment | {"XDG_CACHE_HOME": str(programs)},
    )


def _spread(values: xr.DataArray) -> str:
    known = values.dropna("repeat").values
    if not len(known):
        return f"{'-':>22}"
    return f"{np.median(known):7.1f} ({known.min():.1f} to {known.max():.1f})".rjust(22)


if __name__ == "__main__":
    main()
