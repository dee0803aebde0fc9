"""``python -m benchmarks.solver run | figures``."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import click

from benchmarks.solver.cube import gathered, read_cube, report, write_cube
from benchmarks.solver.figures import draw_all
from benchmarks.solver.measurement import Measurement
from benchmarks.solver.methods import SWEPT
from benchmarks.solver.plan import GROUPS, Budget, planned
from knitlab.model.threads import ONE_THREAD
from knitlab.runs.workers import WORKER_ENVIRONMENT

CUBE = "solvers.nc"
DEFAULT = Budget()


@click.group()
def main() -> None:
    """Benchmark the solvers."""


@main.command()
@click.option("--only", default=",".join(GROUPS), show_default=True, help="Groups, with commas.")
@click.option("--solvers", help="Only these, with commas.")
@click.option("--sizes", help="Only samples of so many unit cells, as 1x1,3x2.")
@click.option(
    "--results",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results/solver_benchmark"),
    show_default=True,
)
@click.option("--repeats", default=DEFAULT.repeats, show_default=True)
@click.option("--time-limit", default=DEFAULT.time_limit, show_default=True, help="[s]")
@click.option(
    "--once-above",
    default=DEFAULT.once_above,
    show_default=True,
    help="Do not repeat what took longer [s].",
)
def run(
    only: str,
    solvers: str | None,
    sizes: str | None,
    results: Path,
    repeats: int,
    time_limit: float,
    once_above: float,
) -> None:
    """Make the measurements that are missing, then the cube and its figures."""
    groups = only.split(",")
    if unknown := sorted(set(groups) - set(GROUPS)):
        raise click.BadParameter(f"{', '.join(unknown)}: choose from {', '.join(GROUPS)}")
    # Without this a measurement would go on after its parent was terminated, beside the next run.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    failed = 0
    for measurement in planned(groups, Budget(repeats, time_limit, once_above), results):
        if solvers and measurement.solver not in solvers.split(","):
            continue
        if sizes and measurement.size not in sizes.split(","):
            continue
        if measurement.record(results) is None:
            failed += not _measured(measurement, results)
    cube = gathered(results)
    write_cube(cube, results / CUBE)
    click.echo(report(cube))
    for path in draw_all(cube, results / "figures"):
        click.echo(f"figure  {path}")
    sys.exit(1 if failed else 0)


@main.command()
@click.argument("cube", type=click.Path(path_type=Path, exists=True))
@click.option("--output", type=click.Path(path_type=Path), help="Folder; by default beside CUBE.")
def figures(cube: Path, output: Path | None) -> None:
    """Draw the figures from CUBE alone."""
    for path in draw_all(read_cube(cube), output or cube.parent / "figures"):
        click.echo(f"figure  {path}")


def _measured(measurement: Measurement, results: Path) -> bool:
    """Make a measurement in a process of its own; whether it left a record."""
    threads = "1" if measurement.task == "sweep" else str(measurement.workers)
    environment = dict.fromkeys(ONE_THREAD, threads)
    if measurement.solver in SWEPT:
        environment = WORKER_ENVIRONMENT | {"OMP_NUM_THREADS": threads}
    environment |= {"JAX_PLATFORMS": "cpu"}
    module = "benchmarks.solver.one"
    text = json.dumps(asdict(measurement))
    ran = subprocess.run(
        [sys.executable, "-m", module, text, str(results)],
        env=os.environ | environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    record = measurement.record(results) if not ran.returncode else None
    if record is None:
        click.echo(f"{measurement.name}: failed\n{ran.stderr}", err=True)
        return False
    said = f"{record['seconds']:.3g} s" if record["reached"] else f"not reached: {record['reason']}"
    click.echo(f"{measurement.name}: {said}")
    return True


if __name__ == "__main__":
    main()
