"""Time of the dynamics: ``python -m benchmarks.dynamics`` in the repository.

Every measurement is made in a process of its own, after a short motion that compiles, which is not
counted. All are made in turn, several times, so that a machine whose speed changes affects all
alike. The cube holds every repeat and the medians; a second call resumes the first. Nothing of it
is a test: figures depend on the machine.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import click
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr

from benchmarks.command_line import results_in
from benchmarks.solver.cube import machine, write_cube
from knitlab.cubes.cube_file import CUBE
from knitlab.io.provenance import provenance
from knitlab.model.fabric import flat_sheet
from knitlab.model.threads import ONE_THREAD
from knitlab.runs.plan import make_plan
from knitlab.runs.simulate import moving_fabrics, tensile_tests
from knitlab.solvers.case import Case
from knitlab.solvers.dynamics.damped_test import on_grid
from knitlab.solvers.dynamics.motion import Motion, leapfrog

STEPS, STEP = 50, 1e-4
"""Time steps that are timed on a large sample, and their size [ms]."""
SHORT = 0.05
"""Time of the relaxation that compiles [ms]."""
SETTINGS = (
    "method=dynamics",
    "cell_size=relaxed",
    "ending=time",
    "relax_time=40",
    "strain_rate=0.012",
    "strain_max=0.48",
)
"""40 ms of relaxation, then 48 % in 40 ms."""
FACTORS = "k_t_factor=0.7,0.8,0.9,1,1.1,1.2,1.3,1.4"
"""What the fabrics of a batch differ in."""


def cases(workflow: str, *settings: str) -> list[Case]:
    """Cases of a workflow by dynamics that end after a time."""
    return list(make_plan(workflow, (*SETTINGS, *settings)).cases.values())


def step_seconds(*settings: str) -> float:
    """Time of one step of a sample [s]."""
    (case,) = cases("preview", *settings)
    (body,) = moving_fabrics([case]).bodies(clamped=False)
    motion = Motion.at_rest(on_grid(flat_sheet(*case.assemble())))
    leap, began = eqx.filter_jit(leapfrog), 0.0
    for count in (jnp.asarray(1), jnp.asarray(STEPS)):
        began = time.perf_counter()
        leap(body, motion, jnp.asarray(STEP), count, count).dissipated.block_until_ready()
    return (time.perf_counter() - began) / STEPS


def whole_test_seconds(workflow: str, *settings: str, together: bool = True) -> float:
    """Time of relaxation and test of all cases, as one batch or one after the other [s]."""
    of_all = cases(workflow, *settings)
    batches = [of_all] if together else [[case] for case in of_all]
    short = [
        replace(
            case,
            dynamics=replace(case.motion, relax_time=SHORT),
            applied_strain=(*case.applied_strain[:1], SHORT * case.motion.strain_rate),
        )
        for case in batches[0]
    ]
    tensile_tests(short, lambda *_: None)
    began = time.perf_counter()
    for batch in batches:
        tensile_tests(batch, lambda *_: None)
    return time.perf_counter() - began


@dataclass(frozen=True)
class Timed:
    """What is timed.

    Attributes:
        measure: returns its time [s].
        aim: time that it should not exceed, NaN if there is none [s].
        threads: of its process.
    """

    measure: Callable[[], float]
    aim: float = np.nan
    threads: int = 1


LARGE = partial(step_seconds, "n_stripe=4", "n_subunit=16", "boundary=clamped", "unit_cells=22,11")
BATCH = "preview", "n_stripe=4", "n_subunit=16", "boundary=periodic", "unit_cells=1,1", FACTORS
TOGETHER, IN_TURN = "8 periodic fabrics, together", "8 periodic fabrics, one after the other"
TIMED = {
    "step of 62,481 nodes, one thread": Timed(LARGE, 6e-3),
    "step of 62,481 nodes, two threads": Timed(LARGE, 3e-3, threads=2),
    "test of 1,617 nodes": Timed(
        partial(
            whole_test_seconds,
            "preview",
            "n_stripe=4",
            "n_subunit=16",
            "boundary=clamped",
            "unit_cells=3,2",
        ),
        8.0,
    ),
    "test of (8, 32) at full size": Timed(
        partial(whole_test_seconds, "paper", "n_stripe=8", "n_subunit=32"), 45.0
    ),
    "test of (4, 16) at full size": Timed(
        partial(whole_test_seconds, "paper", "n_stripe=4", "n_subunit=16"), 360.0
    ),
    TOGETHER: Timed(partial(whole_test_seconds, *BATCH)),
    IN_TURN: Timed(partial(whole_test_seconds, *BATCH, together=False)),
}


@click.command()
@click.option("--repeats", default=3, show_default=True, help="Repeats of every measurement.")
@click.option("--only", multiple=True, type=click.Choice(list(TIMED)), help="Only these.")
@results_in("dynamics_benchmark")
@click.option("--here", type=click.Choice(list(TIMED)), help="Time one in this process, once.")
def main(repeats: int, only: tuple[str, ...], results: Path, here: str | None) -> None:
    """Time the dynamics and print the median of the repeats, with the aim."""
    if here:
        click.echo(TIMED[here].measure())
        return
    path = results / CUBE
    cube = _kept(path, repeats)
    for repeat in range(repeats):
        for name in only or TIMED:
            place = {"measurement": name, "repeat": repeat}
            if cube["seconds"].sel(place).isnull():
                cube["seconds"].loc[place] = _measured(name)
                cube["seconds_median"].values[:] = cube["seconds"].median("repeat").values
                write_cube(cube, path)
    for name in only or TIMED:
        found, aim = (float(cube[of].sel(measurement=name)) for of in ("seconds_median", "aim"))
        click.echo(f"{name:42} {found:10.4g} s   aim {aim:g} s")
    in_turn, together = (cube["seconds_median"].sel(measurement=n) for n in (IN_TURN, TOGETHER))
    click.echo(f"{'a batch is faster together by':42} {float(in_turn / together):10.3g}     aim 2")


def _kept(path: Path, repeats: int) -> xr.Dataset:
    """The cube with every measurement so far, and room for all others."""
    empty, names = np.full((len(TIMED), repeats), np.nan), list(TIMED)
    cube = xr.Dataset(
        {
            "seconds": (("measurement", "repeat"), empty, _attributes("wall time")),
            "seconds_median": ("measurement", empty[:, 0].copy(), _attributes("median wall time")),
            "aim": (
                "measurement",
                [timed.aim for timed in TIMED.values()],
                _attributes("wall time that should not be exceeded"),
            ),
        },
        {"measurement": names, "repeat": range(repeats)},
        {**provenance(), **machine()},
    )
    if not path.exists():
        return cube
    with xr.open_dataset(path) as kept:
        if kept.attrs["git_commit"] != cube.attrs["git_commit"]:
            raise click.UsageError(f"{path} is of another commit; remove it to measure this one")
        return kept.load().reindex(measurement=names, repeat=range(repeats))


def _attributes(long_name: str) -> dict[str, str]:
    return {"units": "s", "long_name": long_name}


def _measured(name: str) -> float:
    """Time one in a process of its own, which compiles for its threads [s]."""
    threads = dict.fromkeys(ONE_THREAD, str(TIMED[name].threads))
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks.dynamics", "--here", name],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | threads | {"JAX_ENABLE_COMPILATION_CACHE": "0"},
    )
    return float(ran.stdout.split()[-1])


if __name__ == "__main__":
    main()
