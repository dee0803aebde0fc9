"""The command ``design``."""

import sys
from pathlib import Path

import click

from knitlab.cli.cubes import format_option
from knitlab.cli.options import SOME_CASE_NOT_OK, explains_bad_input, results_option, workers_option


@click.command()
@click.argument("file", metavar="TARGETS.toml", type=click.Path(path_type=Path, dir_okay=False))
@results_option
@click.option(
    "--budget",
    default="60",
    show_default=True,
    metavar="N|MINUTESmin",
    help="Largest number of simulations of coarse sweep and searches, or a time such as 30min.",
)
@workers_option(0)
@format_option
@explains_bad_input
def design(file: Path, results: Path, budget: str, workers: int, style: str) -> None:
    """Find the stripes and sizes that come closest to the targets of a TOML file, by simulation.

    Writes a cube of the candidates, a workflow that reproduces each, a table of all trials, and
    figures into a folder with the name of the file. An interrupted design continues when it is
    run again.
    Exit code 1 if no candidate meets all targets.
    """
    from knitlab.api.designing import design as design_for
    from knitlab.api.designing import draw
    from knitlab.cube.cube_file import CUBE
    from knitlab.cube.query import formatted
    from knitlab.inverse.conflict import conflict_of
    from knitlab.inverse.summary import summary

    try:
        designed = design_for(file, budget=budget, workers=workers, results=results, progress=True)
    except KeyboardInterrupt:
        click.echo("stopped: finished simulations are kept; run again to continue", err=True)
        sys.exit(SOME_CASE_NOT_OK)
    if style == "table":
        wanted = (*designed.request.targets, *designed.request.subject_to)
        for number, target in enumerate(wanted, start=1):
            kind = "target" if number <= len(designed.request.targets) else "subject to"
            click.echo(f"{kind} {number}: {target.text}")
    click.echo(formatted(designed.table, style))
    for line in summary(designed, conflict_of(designed)):
        click.echo(line, err=style != "table")
    click.echo(f"cube    {designed.folder / CUBE}", err=True)
    for path in designed.workflows:
        click.echo(f"workflow  {path}", err=True)
    for path in draw(designed):
        click.echo(f"figure  {path}", err=True)
    if not designed.met:
        sys.exit(SOME_CASE_NOT_OK)
