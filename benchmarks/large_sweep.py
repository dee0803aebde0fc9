"""Benchmark of large sweeps: ``python -m benchmarks.large_sweep`` in the repository.

It plans a sweep of ten designs and many factors of k_t and k_s, has it simulated in 40 shards in
four folders, merges these, builds the cube of the whole from the case files, and then asks what
users ask. Each step runs as a separate process, and the system counts its processor time, wall time
and memory. Only the last shard of each folder is run: 40 plans of one sweep would show nothing that
four do not. The simulation alone is replaced, by writing the arrays of one real case with other
numbers under the name of each case.
"""

import math
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import mkdtemp

import click
import numpy as np
import xarray as xr

from benchmarks.command_line import COMMAND
from knitlab.api.sweeps import run_and_draw
from knitlab.cubes.case_file import case_path
from knitlab.io.atomic_write import atomic_write
from knitlab.io.checksum import LENGTH, append_checksum
from knitlab.io.cube_path import CUBE
from knitlab.runs.batches import Shard
from knitlab.runs.plan import make_plan
from knitlab.runs.simulate import simulate_batch
from knitlab.runs.workers import Batch
from knitlab.solvers.method import Progress

WORKFLOW = "periodic"
SMALL = ("strain_max=0.15", "robustness=0")
DESIGNS = 10
SHARDS = 40
FOLDERS = 4
RUN = range(SHARDS // FOLDERS, SHARDS + 1, SHARDS // FOLDERS)
"""The last shard of each folder, which writes its cube."""
TEMPLATE = "case.nc"
MERGED = "merged"


def settings(cases: int) -> list[str]:
    """Settings of a sweep of about a number of cases, whose identifiers have one length."""
    count = max(1, round(math.sqrt(cases / DESIGNS)))
    numbers = [number for number in range(501, 1000) if number % 10]
    values = ",".join(f"{number / 1000:g}" for number in numbers[:count])
    return [f"k_t_factor={values}", f"k_s_factor={values}", *SMALL]


def write_template(folder: Path) -> None:
    """Simulate one case, and write its file as a run does."""
    plan = make_plan(WORKFLOW, [*settings(4 * DESIGNS), "n_stripe=4", "n_subunit=16"])
    case = next(iter(plan.cases.values()))
    simulate_batch(folder, [case], lambda *_: None)
    case_path(folder, case.case_id).replace(folder / TEMPLATE)


class StandIn:
    """Simulates by writing the file of one real case, with other numbers and another name."""

    def __init__(self, template: Path) -> None:
        self.contents = template.read_bytes()[:-LENGTH]
        real = xr.load_dataset(template, engine="netcdf4", mask_and_scale=False)
        self.case_id = real["case_id"].item().encode()
        stored = {
            name: np.asarray(each, ">f8") for name, each in real.items() if each.dtype == float
        }
        self.numbers = {self.contents.index(each.tobytes()): each for each in stored.values()}

    def __call__(self, results: Path, cases: Batch, progress: Progress) -> None:
        """Write the case files of a batch."""
        for case in cases:
            contents = bytearray(self.contents.replace(self.case_id, case.case_id.encode()))
            factor = 1 + int(case.case_id[-12:], 16) / 16**12 / 10
            for place, values in self.numbers.items():
                contents[place : place + values.nbytes] = (factor * values).astype(">f8").tobytes()
            with atomic_write(case_path(results, case.case_id)) as temporary:
                temporary.write_bytes(contents)
                append_checksum(temporary)
            progress(case.case_id, case.states)


def run_shard(folder: Path, number: int, cases: int) -> None:
    """Run one shard, as ``knitlab run --shard`` does."""
    run_and_draw(
        WORKFLOW,
        settings(cases),
        part(folder, number),
        warn=click.echo,
        shard=f"{number}/{SHARDS}",
        workers=0,
        simulate=StandIn(folder / TEMPLATE),
    )


def write_other_shards(folder: Path, cases: int) -> None:
    """Write the case files of the shards that are not run."""
    plan, simulate = make_plan(WORKFLOW, settings(cases)), StandIn(folder / TEMPLATE)
    for number in {*range(1, SHARDS + 1)}.difference(RUN):
        share = plan.share(Shard(number, SHARDS))
        simulate(part(folder, number) / WORKFLOW, [*share.cases.values()], lambda *_: None)


def part(folder: Path, number: int) -> Path:
    """The folder of a shard."""
    return folder / f"part-{(number - 1) * FOLDERS // SHARDS + 1}"


def commands(folder: Path, cases: int) -> dict[str, list[str]]:
    """The commands that follow the shards, by the name of their step."""
    sets = [word for setting in settings(cases) for word in ("--set", setting)]
    merged = str(folder / MERGED)
    cube, results = str(folder / MERGED / WORKFLOW), ["--results", merged]
    parts = [str(folder / f"part-{number + 1}") for number in range(FOLDERS)]
    run = ["run", WORKFLOW, *sets, *results, "--workers", "0"]
    opened = f"import knitlab; print(knitlab.open_cube({cube!r}).sizes)"
    lines = {
        "merge": ["merge", *parts, *results],
        "cube": run,
        "nothing to do": run,
        "query --where": ["query", cube, "--where", "poisson_ratio_min < -0.6"],
        "query --select": ["query", cube, "--select", "k_t_factor=0.501", "--sort", "k_s_factor"],
        "query --columns": [
            *("query", cube, "--where", "poisson_ratio < -0.55", "--select", "applied_strain=0.15")
        ],
        "status": ["status", WORKFLOW, *results],
        "status --check": ["status", WORKFLOW, *results, "--check"],
    }
    whole = {name: [*COMMAND, *words] for name, words in lines.items()}
    return whole | {"open_cube": [sys.executable, "-c", opened]}


@click.command()
@click.option("--cases", default=10_000, show_default=True, help="Cases of the sweep.")
@click.option("--folder", type=click.Path(path_type=Path), help="Where to write; else temporary.")
@click.option("--step", "steps", multiple=True, help="Only this step, in a folder of an earlier.")
@click.option("--shard", type=int, hidden=True)
def main(cases: int, folder: Path | None, steps: tuple[str, ...], shard: int | None) -> None:
    """Measure each step of a sweep: seconds of processor and wall, gigabytes of memory."""
    folder = folder or Path(mkdtemp(prefix="knitlab-"))
    if shard:
        run_shard(folder, shard, cases)
        return
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / TEMPLATE).exists():
        write_template(folder)

    def wanted(name: str) -> bool:
        return not steps or name in steps

    sets = [word for setting in settings(cases) for word in ("--set", setting)]
    plan = [*COMMAND, "plan", WORKFLOW, *sets, "--results", str(folder / "plan")]
    if wanted("plan"):
        report("plan", [usage(plan)])
    if wanted("shards"):
        write_other_shards(folder, cases)
        own = [sys.executable, "-m", "benchmarks.large_sweep", "--cases", str(cases)]
        own += ["--folder", str(folder), "--shard"]
        with ThreadPoolExecutor(FOLDERS) as pool:
            used = list(pool.map(lambda number: usage([*own, str(number)]), RUN))
        report(f"{len(RUN)} of {SHARDS} shards", used)
    for name, words in commands(folder, cases).items():
        if wanted(name):
            if name == "cube":
                (folder / MERGED / WORKFLOW / CUBE).unlink(missing_ok=True)
            report(name, [usage(words)])
    for path in sorted((folder / MERGED / WORKFLOW).glob("[!.]*")):
        click.echo(f"{size(path) / 1e6:10.1f} MB  {path.relative_to(folder)}")


def usage(words: Sequence[str]) -> tuple[float, float, float]:
    """Wall time [s], processor time [s] and peak memory [GB] of a process."""
    began = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(words)[-300:]} ended with {status}")
    wall = time.perf_counter() - began
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6


def report(name: str, used: Iterable[tuple[float, float, float]]) -> None:
    """Print the time of a step in all, and the largest memory of its processes."""
    walls, processor, memory = zip(*used, strict=True)
    click.echo(
        f"{name:16} processor {sum(processor):8.1f} s  wall {sum(walls):8.1f} s"
        f"  memory {max(memory):5.2f} GB"
    )


def size(path: Path) -> int:
    """Bytes of a file or of the files in a folder."""
    return sum(each.stat().st_size for each in (path, *path.rglob("*")) if each.is_file())


if __name__ == "__main__":
    main()
