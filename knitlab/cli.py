"""The command line: ``knitlab plan | run | status | reproduce | query | map | claims | …``."""

import json
import os
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import click

from knitlab.sweep.faults import BadInput
from knitlab.sweep.figure_names import FigureName

if TYPE_CHECKING:
    from knitlab.sweep.plan import Plan

# Each command imports what it needs, so that `query` and `map` start without JAX.

KINDS = get_args(FigureName)
BAD_INPUT = 2
SOME_CASE_NOT_OK = 1
MOST_LINES = 20
"""Cases of which a command lists that many."""

Command = Callable[..., None]


def explains_bad_input(command: Command) -> Command:
    """Turn bad input into its message and exit code 2."""

    @wraps(command)
    def explained(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except BadInput as error:
            for fault in error.faults:
                click.echo(f"knitlab: {fault}", err=True)
            sys.exit(BAD_INPUT)

    return explained


results_option = click.option(
    "--results",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results"),
    show_default=True,
    help="Folder that holds a folder of results for each workflow.",
)


def workflow_options(command: Command) -> Command:
    """The argument and options that name a workflow and its results."""

    @wraps(command)
    def scaled(
        *arguments: Any, overrides: tuple[str, ...], scale: float | None, **options: Any
    ) -> None:
        added = () if scale is None else (f"scale={scale:g}",)
        command(*arguments, overrides=(*overrides, *added), **options)

    for option in (
        results_option,
        click.option(
            "--scale",
            type=click.FloatRange(min=0, max=1, min_open=True),
            help="Part of the needles that a sample is knitted on; short for --set scale=.",
        ),
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            help="Override a setting of the workflow; a comma makes a list. Repeatable.",
        ),
        click.argument("workflow"),
    ):
        scaled = option(scaled)
    return scaled


select_option = click.option(
    "--select",
    "selections",
    multiple=True,
    metavar="NAME=VALUE",
    help="Keep one value of a coordinate, or several with commas. Repeatable.",
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="knitlab")
def main() -> None:
    """Simulate folding knits and find the one you need."""


@main.command()
@workflow_options
@explains_bad_input
def plan(workflow: str, results: Path, overrides: tuple[str, ...]) -> None:
    """Resolve WORKFLOW into plan.json and say what it would run."""
    from knitlab.sweep.lock import held
    from knitlab.sweep.plan import make_plan
    from knitlab.sweep.status import PLAN, folder_status

    made = make_plan(workflow, overrides)
    folder = results / made.workflow
    with held(folder):
        made.write(folder / PLAN)
    status = folder_status(folder, made.record(), made.designs, check=False)
    click.echo(made.title)
    for number, batch in enumerate(made.batches[:MOST_LINES], start=1):
        click.echo(
            f"batch {number}: {len(batch.cases)} cases, {batch.unknowns} unknowns, about"
            f" {_duration(batch.estimated_seconds)}, {batch.estimated_bytes / 1e9:.1f} GB"
        )
        for case_id in batch.cases[:MOST_LINES]:
            case = made.cases[case_id]
            click.echo(f"  {case.label}  P {case.periods}  {case_id}  {status.words[case_id]}")
        if len(batch.cases) > MOST_LINES:
            click.echo(f"  … and {len(batch.cases) - MOST_LINES} more")
    if len(made.batches) > MOST_LINES:
        click.echo(f"… and {len(made.batches) - MOST_LINES} more batches")
    _echo_excluded(made)
    strains = made.applied_strain
    time = _duration(sum(batch.estimated_seconds for batch in made.batches))
    click.echo(
        f"{len(made.cases)} cases, {len(strains)} strains from 0 to {strains[-1]:g},"
        f" about {time} on one core; plan in {folder / PLAN}"
    )
    click.echo(_counted(status.counts))


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _echo_excluded(made: "Plan") -> None:
    for design, reason in made.excluded.items():
        labels = zip(made.dims, design, strict=False)
        click.echo(f"excluded: {'  '.join(f'{name} {label}' for name, label in labels)}: {reason}")


@main.command()
@workflow_options
@click.option(
    "--workers",
    type=click.IntRange(min=0),
    default=os.cpu_count() or 1,
    show_default="all cores",
    help="Worker processes on this machine; 0 runs in this process.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Use this dask scheduler instead.")
@click.option(
    "--retries",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="How often to try a batch again that raised an error.",
)
@click.option(
    "--keep-going/--fail-fast",
    default=True,
    show_default=True,
    help="Whether to go on after a case that is not ok.",
)
@click.option(
    "--case-timeout",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Longest time for one case.",
)
@click.option("--refresh", is_flag=True, help="Compute stale results anew.")
@click.option("--dashboard", is_flag=True, help="Open dask's dashboard on this machine.")
@explains_bad_input
def run(
    workflow: str,
    results: Path,
    overrides: tuple[str, ...],
    workers: int,
    scheduler: str | None,
    retries: int,
    keep_going: bool,
    case_timeout: float | None,
    refresh: bool,
    dashboard: bool,
) -> None:
    """Simulate the cases of WORKFLOW that are missing, build its cube and draw its figures."""
    from knitlab.maps.figures import draw_figures
    from knitlab.sweep.plain_cube import CUBE
    from knitlab.sweep.plan import make_plan
    from knitlab.sweep.run import RunOptions, run_plan

    made = make_plan(workflow, overrides)
    folder = results / made.workflow
    options = RunOptions(
        workers=workers,
        scheduler=scheduler,
        retries=retries,
        fail_fast=not keep_going,
        case_timeout=case_timeout,
        refresh=refresh,
        dashboard=dashboard,
        show_progress=True,
    )
    done = run_plan(made, folder, options)
    _echo_excluded(made)
    click.echo(f"{len(done.simulated)} cases simulated, {len(done.reused)} already there")
    click.echo(f"cube    {folder / CUBE}")
    figures, faults = draw_figures(made.figures, folder)
    for path in figures:
        click.echo(f"figure  {path}")
    for fault in faults:
        click.echo(f"knitlab: {fault}", err=True)
    for failure in done.failures:
        design = "  ".join(f"{name} {failure[name]}" for name in made.dims)
        click.echo(f"{failure['status']}: {design}: {failure['reason']}", err=True)
    for remark in done.remarks(folder):
        click.echo(remark, err=True)
    if done.failures or done.stale_parameters or done.stopped:
        sys.exit(SOME_CASE_NOT_OK)


@main.command()
@click.argument("workflow")
@results_option
@click.option("--check", is_flag=True, help="Compare every case file with its checksum.")
@click.option("--json", "as_json", is_flag=True, help="For scripts.")
@explains_bad_input
def status(workflow: str, results: Path, check: bool, as_json: bool) -> None:
    """Say how far the last plan of WORKFLOW has come, and what of it is stale.

    If a file that the plan was made of has changed, the workflow is resolved anew, with the same
    settings.
    """
    from knitlab.sweep.status import changed_inputs, folder_status, planned_designs, read_plan

    folder = results / Path(workflow).stem
    record = read_plan(folder)
    designs = planned_designs(record)
    if changed_inputs(record):
        from knitlab.sweep.plan import make_plan

        designs = make_plan(workflow, tuple(record["overrides"])).designs
    found = folder_status(folder, record, designs, check)
    if as_json:
        click.echo(json.dumps(found.record(), indent=1))
        return
    click.echo(f"{len(found.designs)} cases: {_counted(found.counts)}")
    for path in found.changed:
        click.echo(f"changed since the plan: {path}")
    not_ok = [case_id for case_id, word in found.words.items() if word != "ok"]
    for case_id in not_ok[:MOST_LINES]:
        reason = found.failures.get(case_id, "")
        said = f"{found.words[case_id]}: {reason}" if reason else found.words[case_id]
        click.echo(f"  {found.label(case_id)}  {case_id}  {said}")
    if len(not_ok) > MOST_LINES:
        click.echo(f"  … and {len(not_ok) - MOST_LINES} more; --json lists them all")


@main.command()
@click.argument("case_id")
@results_option
@explains_bad_input
def reproduce(case_id: str, results: Path) -> None:
    """Run one case alone, in this process, and say how every state was reached."""
    from knitlab.sweep.reproduce import find_case
    from knitlab.sweep.reproduce import reproduce as run_alone

    if not run_alone(find_case(results, case_id), click.echo):
        sys.exit(SOME_CASE_NOT_OK)


@main.command()
@click.argument("cube", type=click.Path(path_type=Path))
@select_option
@click.option("--where", metavar="EXPRESSION", help="Keep the designs for which this holds.")
@click.option("--sort", metavar="NAME", help="Sort by a variable, ascending; -NAME descends.")
@click.option("--columns", metavar="NAMES", help="Columns to show, separated by commas.")
@click.option(
    "--format",
    "style",
    type=click.Choice(["table", "csv", "json"]),
    default="table",
    show_default=True,
)
@explains_bad_input
def query(
    cube: Path,
    selections: tuple[str, ...],
    where: str | None,
    sort: str | None,
    columns: str | None,
    style: str,
) -> None:
    """List the designs of CUBE.

    Variables along the applied strain appear once it is selected: --select applied_strain=0.15
    """
    from knitlab.maps.query import designs_table, formatted, queried
    from knitlab.sweep.plain_cube import open_plain_cube

    table = designs_table(open_plain_cube(cube), selections)
    names = tuple(name.strip() for name in columns.split(",")) if columns else None
    click.echo(formatted(queried(table, where, sort, names), style))


@main.command(name="map")
@click.argument("kind", type=click.Choice(KINDS))
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File to draw; its suffix (.pdf, .svg, .png; .gif for folding) sets the format.",
)
@select_option
@explains_bad_input
def draw_map(kind: str, cubes: tuple[Path, ...], output: Path, selections: tuple[str, ...]) -> None:
    """Draw a figure of KIND from CUBES, of which most kinds take one."""
    from knitlab.maps.figures import draw_figure

    click.echo(f"figure  {draw_figure(kind, cubes, output, selections)}")


@main.command()
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@select_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Page to write, .md or .html; its figures lie in a folder beside it.",
)
@explains_bad_input
def claims(cubes: tuple[Path, ...], selections: tuple[str, ...], output: Path | None) -> None:
    """Judge what the paper says by CUBES: each claim holds, fails, or is not measured.

    Of several cubes the first that measures a claim decides it.
    """
    from knitlab.maps.claims import judged, read_claims
    from knitlab.maps.claims_page import check_suffix, listed, write_page

    if output is not None:
        check_suffix(output)
    judgements = judged(read_claims(), cubes, selections)
    click.echo(listed(judgements))
    if output is not None:
        files, faults = write_page(judgements, output, selections)
        for path in files:
            click.echo(f"{'page' if path == output else 'figure':6}  {path}")
        for fault in faults:
            click.echo(f"knitlab: {fault}", err=True)


MILLIMETRES = click.FloatRange(min=0, min_open=True, max=1e6)


@main.command()
@click.argument("curve", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--stripe", "knit", type=click.Choice(["rib", "garter"]), required=True)
@click.option("-n", "stitches", type=click.IntRange(min=1), required=True, help="Its stitches.")
@click.option(
    "--period", type=MILLIMETRES, required=True, help="Relaxed peak-to-peak distance [mm]."
)
@click.option("--width", type=MILLIMETRES, help="Width of one row, for a curve of stress [mm].")
@click.option("--thickness", type=MILLIMETRES, help="Of the fabric, for stress over area [mm].")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Stripe entry to write, .toml; figures lie beside it. [default: STRIPE-N.toml]",
)
@explains_bad_input
def calibrate(
    curve: Path,
    knit: Literal["rib", "garter"],
    stitches: int,
    period: float,
    width: float | None,
    thickness: float | None,
    output: Path | None,
) -> None:
    """Fit k_s, k_t and theta_0 of a stripe to the tension CURVE of its pure fabric.

    CURVE is a CSV file with a header such as "strain [1],force [N]": the force on one row of the
    network, or the stress with the row's --width. Measure until the folds are open and the springs
    stretch, to about 200 % strain: short of that the three cannot be told apart.
    """
    from knitlab.sweep.curve_file import read_tension_curve
    from knitlab.sweep.faults import fault

    output = output or Path(f"{knit}-{stitches}.toml")
    if output.suffix != ".toml":
        raise fault(f"-o {output}", "has no suffix .toml; give it one")
    measured = read_tension_curve(curve, width, thickness)

    from knitlab.maps.calibration import calibration_figure
    from knitlab.maps.figures import save
    from knitlab.maps.style import print_style
    from knitlab.measure.calibration import calibrate as fit
    from knitlab.measure.calibration import report
    from knitlab.sweep.stripe_file import write_stripe_file

    title = f"{stitches} × {stitches} {knit}, period {period:g} mm"
    try:
        found = fit(period, measured.strain, measured.force)
    except ValueError as problem:
        raise fault(str(curve), str(problem)) from problem
    click.echo(title)
    for line in report(found):
        click.echo(line)
    for warning in found.warnings:
        click.echo(f"knitlab: {warning}", err=True)
    if found.usable:
        write_stripe_file(output, knit, stitches, found, curve)
        click.echo(f"stripe   {output}")
    else:
        click.echo("knitlab: no stripe is written, for this fit cannot be used", err=True)
    with print_style():
        figure = calibration_figure(found.strain, found.force, found.fitted_force, title)
        for suffix in (".pdf", ".png"):
            save(figure, output.with_suffix(suffix))
            click.echo(f"figure   {output.with_suffix(suffix)}")
    if not found.usable:
        sys.exit(SOME_CASE_NOT_OK)
