"""Commands on laboratory records: ``import``, ``fit``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from knitlab.cli.options import (
    SOME_CASE_NOT_OK,
    check_toml,
    explains_bad_input,
    read_selections,
    results_option,
    select_option,
    set_option,
)

if TYPE_CHECKING:
    from knitlab.laboratory.description import RecordKind


@click.group(name="import")
def import_group() -> None:
    """Import laboratory records as a cube, to compare with simulations."""


def _importing(kind: "RecordKind", summary: str) -> click.Command:
    @click.command(name=kind, help=summary)
    @click.argument("description", type=click.Path(path_type=Path, dir_okay=False))
    @results_option
    @explains_bad_input
    def command(description: Path, results: Path) -> None:
        from knitlab.laboratory.experiment import import_records

        imported = import_records(kind, description, results)
        for line in imported.summary:
            click.echo(line)
        click.echo(f"cube    {imported.path}")

    return command


_SUMMARIES: "dict[RecordKind, str]" = {
    "markers": "Import the tracked markers described by DESCRIPTION, a TOML file.",
    "tensile": "Import the tensile test described by DESCRIPTION, a TOML file.",
    "capacitance": "Import the log of an LCR meter described by DESCRIPTION, a TOML file.",
}
for _kind, _summary in _SUMMARIES.items():
    import_group.add_command(_importing(_kind, _summary))


@click.command()
@click.argument("experiment", type=click.Path(path_type=Path))
@click.argument("workflow")
@set_option
@select_option
@click.option(
    "--looseness",
    type=click.FloatRange(min=0, max=2, min_open=True),
    default=0.2,
    show_default=True,
    help="Relative standard deviation of the tabulated stripes.",
)
@click.option(
    "--model-error",
    type=click.FloatRange(min=0, max=1),
    default=0.01,
    show_default=True,
    help="Error of the model, as a fraction of the largest value of a curve.",
)
@click.option(
    "--starts",
    type=click.IntRange(min=1, max=64),
    default=4,
    show_default=True,
    help="Largest number of starts to try until the test is matched.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("fitted.toml"),
    show_default=True,
    help="Stripes to write, .toml, with figures beside it.",
)
@explains_bad_input
def fit(
    experiment: Path,
    workflow: str,
    settings: tuple[str, ...],
    selections: tuple[str, ...],
    looseness: float,
    model_error: float,
    starts: int,
    output: Path,
) -> None:
    """Fit k_s, k_t and theta_0 of both stripes to an imported EXPERIMENT on a whole fabric.

    The sample is the only case of WORKFLOW with the design of the experiment. It is simulated
    about ten to thirty times.
    """
    from knitlab.cube.cube_file import open_cube
    from knitlab.cube.selection import selected

    check_toml(output)
    cube = selected(open_cube(experiment), read_selections(selections))

    from knitlab.api.laboratory import fit as fit_test
    from knitlab.figures.figure_files import save
    from knitlab.figures.fits import Fitted, fit_figure
    from knitlab.figures.style import print_style
    from knitlab.laboratory.fit_report import report, write_stripes
    from knitlab.sweep.plan import make_plan

    def report_step(tests: int, chi_squared: float) -> None:
        click.echo(f"test {tests}: chi² {chi_squared:.4g}", err=True)

    found = fit_test(
        cube,
        make_plan(workflow, settings),
        looseness=looseness,
        model_error=model_error,
        starts=starts,
        step=report_step,
    )
    for line in report(found):
        click.echo(line)
    for warning in found.warnings:
        click.echo(f"knitlab: {warning}", err=True)
    write_stripes(output, found, experiment)
    click.echo(f"stripes  {output}")
    shown = Fitted(
        found.target.applied_strain,
        found.target.values,
        found.target.errors,
        *found.curves,
        found.factors,
        found.standard_errors,
    )
    with print_style():
        figure = fit_figure(shown, f"{found.before.label}, fitted to {experiment}")
        for suffix in (".pdf", ".png"):
            save(figure, output.with_suffix(suffix))
            click.echo(f"figure   {output.with_suffix(suffix)}")
    if not found.converged:
        sys.exit(SOME_CASE_NOT_OK)
