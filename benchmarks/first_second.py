"""Where the time of a short run goes: ``python -m benchmarks.first_second LABEL``.

Each run of the command line is a process of its own, which simulates without workers, so that all
of its processor time can be told apart: imports, compilation by JAX (tracing, lowering, and
compiling or loading a program), mechanics, measurement of the states, cube and case files, figures,
and the rest. Medians of several repeats are kept under a label, such as ``before`` and ``after``,
and drawn as stacked bars. To measure an older commit, run this file in a checkout of it, with the
same ``--results``.
"""

import builtins
import importlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

RUNS = {
    "one design": ("periodic", "--set", "n_stripe=4", "--set", "n_subunit=16"),
    "preview": ("preview",),
}
STAGES = ("imports", "compilation", "mechanics", "measurement", "cube", "figures", "rest")
TIMED = {
    "knitlab.simulation.simulate:tensile_tests": "mechanics",
    "knitlab.simulation.simulate:sibling_tests": "mechanics",
    "knitlab.simulation.simulate:measured": "measurement",
    "knitlab.simulation.simulate:write_case_file": "cube",
    "knitlab.sweep.run:build_cube": "cube",
    "knitlab.sweep.run:write_cube": "cube",
    "knitlab.figures.drawing:draw_figures": "figures",
}
"""Functions whose time counts as a stage, but for other stages within."""


class Clock:
    """Processor time of this process by stage; time belongs to the innermost stage [s]."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)
        self.stages = ["rest"]
        self.since = 0.0  # since the process began, its interpreter included

    def turn(self) -> None:
        """Count what has passed since the last turn to the present stage."""
        now = time.process_time()
        self.seconds[self.stages[-1]] += now - self.since
        self.since = now

    def timed(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """The function, with its time counted to a stage."""

        def call(*arguments: Any, **options: Any) -> Any:
            self.enter(stage)
            try:
                return function(*arguments, **options)
            finally:
                self.leave()

        return call

    def enter(self, stage: str) -> None:
        """Count time to a stage from now on."""
        self.turn()
        self.stages.append(stage)

    def leave(self) -> None:
        """Count time to the stage before from now on."""
        self.turn()
        self.stages.pop()


def after(first: Callable[[], None], function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, called after another one."""

    def call(*arguments: Any) -> Any:
        first()
        return function(*arguments)

    return call


def measure(words: list[str]) -> None:
    """Run a command line in this process and print its processor time by stage as JSON."""
    clock = Clock()
    builtins.__import__ = clock.timed(builtins.__import__, "imports")
    importlib.import_module = clock.timed(importlib.import_module, "imports")
    from jax._src.dispatch import LogElapsedTimeContextManager

    from knitlab.cli import main

    # JAX reports these times when they have ended, when it no longer says what they are part of.
    for name, turn in (
        ("__enter__", partial(clock.enter, "compilation")),
        ("__exit__", clock.leave),
    ):
        own = getattr(LogElapsedTimeContextManager, name)
        setattr(LogElapsedTimeContextManager, name, after(turn, own))
    for place, stage in TIMED.items():
        module, name = place.split(":")
        holder = importlib.import_module(module)
        setattr(holder, name, clock.timed(getattr(holder, name), stage))
    try:
        main(words, standalone_mode=False)
    except SystemExit as ended:
        if ended.code:
            raise
    clock.turn()
    print(json.dumps(clock.seconds))


def repeated(words: tuple[str, ...], cold: bool, repeats: int) -> dict[str, float]:
    """Median processor time by stage of a run in a process of its own [s]."""
    measured = []
    with TemporaryDirectory() as temporary:
        results, programs = Path(temporary, "results"), Path(temporary, "programs")
        environment = os.environ | {"XDG_CACHE_HOME": str(programs)}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)
        for _ in range(repeats if cold else repeats + 1):
            if cold:
                shutil.rmtree(programs, ignore_errors=True)
            shutil.rmtree(results, ignore_errors=True)
            called = ["run", *words, "--results", str(results), "--workers", "0"]
            done = subprocess.run(
                [sys.executable, "-m", "benchmarks.first_second", "--of", json.dumps(called)],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            measured.append(json.loads(done.stdout.splitlines()[-1]))
    kept = measured if cold else measured[1:]  # the first has compiled the programs
    return {stage: float(np.median([each.get(stage, 0) for each in kept])) for stage in STAGES}


def draw(cube: xr.Dataset, path: Path) -> None:
    """Stacked bars of the stages, one for each run and label."""
    bars = cube["processor_time"].stack(bar=("run", "label")).dropna("bar", how="all")
    figure, axes = plt.subplots(figsize=(7, 1.1 + 0.42 * bars.sizes["bar"]), layout="constrained")
    names = [f"{run}, {label}" for run, label in bars["bar"].values]
    left = np.zeros(len(names))
    for stage in STAGES:
        seconds = bars.sel(stage=stage).values
        axes.barh(names, seconds, left=left, label=stage)
        left = left + seconds
    for name, total in zip(names, left, strict=True):
        axes.annotate(f" {total:.1f} s", (total, name), va="center")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.15 * left.max())
    axes.set_xlabel("processor time [s]")
    figure.legend(loc="outside upper center", ncols=4, fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


@click.command()
@click.argument("label", default="after")
@click.option("--repeats", default=3, show_default=True, help="Repeats of every run.")
@click.option(
    "--results",
    type=click.Path(path_type=Path),
    default=Path("results/reference/run_benchmark"),
    show_default=True,
    help="Folder of the cube and the figure.",
)
@click.option("--only", multiple=True, type=click.Choice(list(RUNS)), help="Only these runs.")
@click.option("--of", hidden=True)
def main(label: str, repeats: int, results: Path, only: tuple[str, ...], of: str | None) -> None:
    """Time short runs by stage, print the table, keep it under LABEL and draw all labels."""
    if of is not None:
        measure(json.loads(of))
        return
    table = {
        f"{name}, {'cold' if cold else 'warm'}": repeated(words, cold, repeats)
        for name, words in RUNS.items()
        if name in (only or RUNS)
        for cold in (False, True)
    }
    seconds = xr.DataArray(
        [[[of_run[stage] for stage in STAGES] for of_run in table.values()]],
        {"label": [label], "run": list(table), "stage": list(STAGES)},
        attrs={"units": "s", "long_name": "processor time"},
    )
    path = results / "first_second.nc"
    cube = seconds.to_dataset(name="processor_time")
    if path.exists():
        kept = xr.load_dataset(path)
        labels = dict.fromkeys([*kept["label"].values, label])  # in the order of measurement
        cube = cube.combine_first(kept).reindex(label=list(labels))
    path.parent.mkdir(parents=True, exist_ok=True)
    cube.to_netcdf(path)
    shown = seconds.sel(label=label).to_pandas().assign(all=lambda t: t.sum(axis=1))
    click.echo(shown.round(2).to_string())
    draw(cube, results / "figures" / "first_second.png")


if __name__ == "__main__":
    main()
