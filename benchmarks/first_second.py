"""Where the time of a short run goes: ``python -m benchmarks.first_second LABEL``.

Each run of the command line is a process of its own, which simulates without workers, so that all
of its processor time can be told apart: imports, compilation by JAX (tracing, lowering, and
compiling or loading a program), mechanics, measurement of the states, cube and case files, figures,
and the rest. Medians of several repeats are kept under a label, such as ``before`` and ``after``,
and drawn as stacked bars. To measure an older commit, run this file and ``stage_clock.py`` in a
checkout of it, with the same ``--results``.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from benchmarks.command_line import results_in
from benchmarks.solver.cube import machine, read_cube, write_cube
from benchmarks.stage_clock import STAGES
from knitlab.io.provenance import provenance

RUNS = {
    "one design": ("periodic", "--set", "n_stripe=4", "--set", "n_subunit=16"),
    "preview": ("preview",),
}


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
                [sys.executable, "-m", "benchmarks.stage_clock", *called],
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
@results_in("run_benchmark")
@click.option("--only", multiple=True, type=click.Choice(list(RUNS)), help="Only these runs.")
def main(label: str, repeats: int, results: Path, only: tuple[str, ...]) -> None:
    """Time short runs by stage, print the table, keep it under LABEL and draw all labels."""
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
        kept = read_cube(path)
        labels = dict.fromkeys([*kept["label"].values, label])  # in the order of measurement
        cube = cube.combine_first(kept).reindex(label=list(labels))
    write_cube(cube.assign_attrs({**provenance(), **machine()}), path)
    shown = seconds.sel(label=label).to_pandas().assign(all=lambda t: t.sum(axis=1))
    click.echo(shown.round(2).to_string())
    draw(cube, results / "figures" / "first_second.png")


if __name__ == "__main__":
    main()
