"""The command ``knit``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from knitlab.cli.options import (
    MOST_LINES,
    SOME_CASE_NOT_OK,
    explains_bad_input,
    read_selections,
    repeats_option,
    select_option,
    set_option,
    two_counts,
)

if TYPE_CHECKING:
    from knitlab.api.single_design import SingleDesign


@click.command()
@click.argument("design", metavar="DESIGN|CUBE")
@select_option
@set_option
@repeats_option
@click.option(
    "--needles",
    type=click.IntRange(min=1),
    help="Needles to fill with whole repeats, twice as long as wide.",
)
@click.option(
    "--face",
    type=click.Choice(["front", "back"]),
    help="Face of the fabric for conductors; by default that to which their ridges point.",
)
@click.option(
    "--machine",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a value of params/machine.toml, such as end=drop. Repeatable.",
)
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="File: .k knitout; .svg, .png or .pdf the stitch chart; .csv the chart as a table."
    " Repeatable.",
)
@click.option(
    "--sheet",
    "sheets",
    multiple=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="File for the specification sheet, .pdf, .svg or .png. Repeatable.",
)
@click.option("--check", is_flag=True, help="Check the knitout, and compare it with the chart.")
@explains_bad_input
def knit(
    design: str,
    selections: tuple[str, ...],
    settings: tuple[str, ...],
    repeats: str | None,
    needles: int | None,
    face: Any,
    changes: tuple[str, ...],
    outputs: tuple[Path, ...],
    sheets: tuple[Path, ...],
    check: bool,
) -> None:
    """Chart a design stitch by stitch, and write knitout for a machine.

    DESIGN is a workflow, by its name or file, that --set and --select narrow to one design. A CUBE
    also predicts the relaxed size and the Poisson's ratio of the sheet.
    Exit code 1 if the check finds a fault.
    """
    from knitlab.api.knitting import check_output, knitted
    from knitlab.sweep.figure_names import check_still

    for path in outputs:
        check_output(path)
    for path in sheets:
        check_still(path)
    found = _single_design(design, settings, read_selections(selections))
    sample = knitted(found, two_counts(repeats), needles, face, _values(changes))
    for name, value in sample.specification.rows():
        click.echo(f"{name:13} {value}")
    for remark in sample.specification.remarks:
        click.echo(f"remark: {remark}", err=True)
    for path in outputs:
        click.echo(f"{'knitout' if path.suffix == '.k' else 'chart':13} {sample.save(path)}")
    for path in sheets:
        click.echo(f"{'sheet':13} {sample.save_sheet(path)}")
    if not check:
        return
    checked = sample.check()
    for note in checked.notes:
        click.echo(f"{'check':13} {note}")
    for fault in checked.faults[:MOST_LINES]:
        click.echo(f"knitlab: {fault}", err=True)
    if len(checked.faults) > MOST_LINES:
        click.echo(f"… and {len(checked.faults) - MOST_LINES} more", err=True)
    if checked.faults:
        sys.exit(SOME_CASE_NOT_OK)


def _single_design(
    design: str, settings: tuple[str, ...], selections: dict[str, Any]
) -> "SingleDesign":
    from knitlab.api.single_design import is_cube, of_cube, of_workflow
    from knitlab.io.errors import fault

    if not is_cube(design):
        return of_workflow(design, settings, selections)
    if settings:
        raise fault("settings", "belong to workflows; select a design of a cube instead")
    return of_cube(design, selections)


def _values(changes: tuple[str, ...]) -> dict[str, Any]:
    from knitlab.io.errors import BadInput, Fault
    from knitlab.sweep.workflow_file import read_value

    malformed = [text for text in changes if "=" not in text]
    if malformed:
        raise BadInput(
            Fault(f"machine {text}", "is not KEY=VALUE; give both") for text in malformed
        )
    pairs = (text.partition("=") for text in changes)
    return {name.strip(): read_value(value.strip()) for name, _, value in pairs}
