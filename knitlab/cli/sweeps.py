"""Commands on workflows: `plan`, `run`, `submit`, `merge`, `status`, `reproduce`, `doctor`."""

import json
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click

import knitlab as kl
from knitlab.cli import options
from knitlab.cli.options import (
    COUNT,
    COUNT_OR_ZERO,
    FOLDER,
    POSITIVE,
    flag,
    option,
    repeatable,
)
from knitlab.io.names import one_line

scale = option(
    "--scale",
    "Fraction of the needles that a sample is knitted on; short for --set scale=.",
    click.FloatRange(0, 1, min_open=True),
    **options.AS_SETTING,
)


@click.command()
@click.argument("workflow")
@options.settings
@scale
@options.results
def plan(workflow: str, settings: tuple[str, ...], results: Path) -> None:
    """Resolve WORKFLOW into plan.json and show what it would run."""
    from knitlab.api.sweeps import excluded_designs

    made = kl.plan(workflow, settings, results=results)
    status = kl.status(made.workflow, results=results)
    for warning in made.warnings:
        click.echo(f"warning: {warning}", err=True)
    click.echo(made.title)
    for number, batch in enumerate(made.batches[: options.MAX_LINES], start=1):
        click.echo(
            f"batch {number}: {len(batch.cases)} cases, {batch.unknowns} unknowns, about"
            f" {_duration(batch.estimated_seconds)}, {batch.estimated_bytes / 1e9:.1f} GB"
        )
        lines = []
        for case_id in batch.cases:
            case = made.cases[case_id]
            lines.append(f"{case.label}  P {case.periods}  {case_id}  {status.statuses[case_id]}")
        options.echo_first(lines, indent="  ")
    if len(made.batches) > options.MAX_LINES:
        click.echo(f"… and {len(made.batches) - options.MAX_LINES} more batches")
    _echo_excluded(excluded_designs(made.dims, made.excluded))
    strains = made.applied_strain
    time = _duration(sum(batch.estimated_seconds for batch in made.batches))
    click.echo(
        f"{len(made.cases)} cases, {len(strains)} strains from 0 to {strains[-1]:g},"
        f" about {time} on one core; plan in {results / made.workflow / 'plan.json'}"
    )
    click.echo(_counted(status.counts))


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _echo_excluded(excluded: Iterable[str]) -> None:
    for line in excluded:
        click.echo(f"excluded: {line}")


def of_parts(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of a run that also apply to its parts."""
    for add in (
        flag("--refresh", "Recompute stale results, and those that did not converge."),
        option("--case-timeout SECONDS", "Longest time for one case.", POSITIVE),
        option(
            "--keep-going/--fail-fast",
            "Whether to continue after a case that is not ok.",
            bool,
            default=True,
        ),
        option(
            "--retries",
            "How often to repeat a batch that raised an error.",
            COUNT_OR_ZERO,
            default=0,
        ),
        options.results,
        scale,
        options.settings,
    ):
        command = add(command)
    return command


@click.command()
@click.argument("workflow")
@of_parts
@options.workers(None, shown="all cores, for several batches")
@option("--scheduler ADDRESS", "Use this dask scheduler instead.")
@option(
    "--shard NUMBER/COUNT",
    "Run one part of the plan, as 3/40, beside processes that run the others.",
)
@flag("--dashboard", "Open dask's dashboard on this machine.")
def run(
    workflow: str,
    settings: tuple[str, ...],
    results: Path,
    keep_going: bool,
    shard: str | None,
    **run_options: Any,
) -> None:
    """Simulate the missing cases of WORKFLOW, build its cube and draw its figures.

    The last of several shards to end builds the cube; then run WORKFLOW without it for the figures.
    """
    from knitlab.api.sweeps import run_and_draw

    result = run_and_draw(
        workflow,
        settings,
        results,
        warn=lambda text: click.echo(f"warning: {text}", err=True),
        fail_fast=not keep_going,
        shard=shard,
        show_progress=True,
        **run_options,
    )
    _echo_excluded(result.excluded)
    where = f" in shard {shard}" if shard else ""
    click.echo(f"{result.simulated} cases simulated, {result.reused} already there{where}")
    if result.joined:
        figures = [f"figure  {path}" for path in result.figures]
        options.echo_report([f"cube    {result.folder / 'cube.nc'}", *figures])
    else:
        click.echo("other shards still run; the last one to end writes the cube")
    options.echo_report([], warnings=result.mistakes)
    for line in result.remarks:
        click.echo(one_line(options.with_options(line)), err=True)
    options.exit_unless(result.all_ok)


@click.command()
@click.argument("workflow")
@option("--parts", "Parts of the plan, each a task of an array job.", COUNT, required=True)
@option("--cores", "Cores of each part.", COUNT, default=1)
@repeatable(
    "--sbatch KEY=VALUE",
    "An option of sbatch, such as partition=short; it replaces an estimate.",
)
@flag("--dry-run", "Only write the script.")
@of_parts
def submit(workflow: str, settings: tuple[str, ...], keep_going: bool, **given: Any) -> None:
    """Submit WORKFLOW to SLURM in parts, then a last job that builds the cube and the figures."""
    submitted = kl.submit(workflow, settings, fail_fast=not keep_going, **given)
    for warning in submitted.warnings:
        click.echo(f"warning: {warning}", err=True)
    asked = " ".join(f"--{name}={value}" for name, value in submitted.asked.items())
    click.echo(f"{submitted.cases} cases in {submitted.parts} parts, each with {asked}")
    click.echo(f"script  {submitted.script}")
    if submitted.job:
        click.echo(f"job     {submitted.job}, one task a part")
        click.echo(f"job     {submitted.last}, after them: builds the cube and draws the figures")
    status = ["knitlab", "status", workflow, "--results", str(given["results"])]
    script = shlex.quote(str(submitted.script))
    click.echo(f"to see what is done:       {shlex.join(status)}")
    if not submitted.job:
        click.echo(f"to submit all parts:       sbatch {script}")
    click.echo(f"to run part 1 again:       sbatch --array=1 {script}")
    click.echo(f"to build cube and figures: sbatch --array=0 {script}")


@click.command()
@click.argument("folders", nargs=-1, required=True, type=options.EXISTING_FOLDER)
@option(
    "-o --results",
    "Folder that holds a folder of results for each workflow; what is there is kept.",
    FOLDER,
    default=Path("results"),
)
@flag("--any-code", "Join results of different versions of the model.")
def merge(folders: tuple[Path, ...], results: Path, any_code: bool) -> None:
    """Join the results in FOLDERS, as of shards that ran on several machines.

    Each folder holds the results of a workflow, or is one that a run had as its results. Folders
    that contradict each other are refused.
    """
    from knitlab.api.sweeps import merge_folders

    done = merge_folders(folders, results, any_code=any_code)
    for path in done.damaged:
        click.echo(f"damaged, and left out: {one_line(path)}", err=True)
    click.echo(f"{len(done.sources)} folders, {len(done.copied)} case files copied")
    click.echo(f"{sum(done.counts.values())} designs: {_counted(done.counts)}")
    click.echo(f"cube    {done.folder / 'cube.nc'}")
    options.exit_unless(not done.damaged)


@click.command()
@click.argument("workflow", metavar="WORKFLOW|FOLDER")
@options.results
@flag("--check", "Compare every case file with its checksum.")
@flag("--json as_json", "Print JSON, for scripts.")
def status(workflow: str, results: Path, check: bool, as_json: bool) -> None:
    """Show the status of the cases of the last plan of WORKFLOW, or of the FOLDER of its results.

    If an input file of the plan has changed, the workflow is planned again with the same settings.
    """
    state = kl.status(workflow, results=results, check=check)
    if as_json:
        click.echo(json.dumps(state.record(), indent=1))
        return
    click.echo(f"{len(state.designs)} cases: {_counted(state.counts)}")
    for path in state.changed:
        click.echo(f"changed since the plan: {path}")
    lines = []
    for case_id, word in state.statuses.items():
        if word != "ok":
            reason = f": {state.failures[case_id]}" if state.failures.get(case_id) else ""
            lines.append(f"{state.label(case_id)}  {case_id}  {word}{reason}")
    options.echo_first(lines, indent="  ", more="; --json lists them all")


@click.command()
@click.argument("case_id")
@options.results
def reproduce(case_id: str, results: Path) -> None:
    """Run one case in this process, and show how every state was reached.

    CASE_ID may be the first characters of an identifier. The results are compared with the case
    file, if there is one.
    """
    options.exit_unless(kl.reproduce(case_id, results=results, report=click.echo))


@click.command()
@options.results
@option("--simulate/--no-simulate", "Simulate one design with a known result.", bool, default=True)
def doctor(results: Path, simulate: bool) -> None:
    """Show what this machine offers and whether it computes right, to paste in a report.

    Exit code 1 if something is wrong.
    """
    options.exit_unless(kl.doctor(results=results, simulate=simulate, report=click.echo))


@click.command()
def workflows() -> None:
    """List the workflows that knitlab comes with."""
    for name, title in kl.workflows().items():
        click.echo(f"{name:16} {title}")


@click.command()
@click.argument("word", default="")
def settings(word: str) -> None:
    """List the settings of workflows, or those with WORD in their name or description.

    Each has its table, its default, its possible values and its meaning.
    """
    for each in kl.settings(word):
        default = f"{each.default} {each.unit}".strip() or "-"
        words = "; ".join(filter(None, (each.values, each.meaning)))
        click.echo(f"{each.name:28} {each.section:11} {default:14} {words}")


COMMANDS = (plan, run, submit, merge, status, reproduce, doctor, workflows, settings)
