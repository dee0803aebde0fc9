"""Commands on cubes: ``query``, ``map``, ``claims``."""

import re
from contextlib import suppress
from pathlib import Path

import click

from knitlab.cli.options import explains_bad_input, read_selections, select_option
from knitlab.sweep.figure_names import FIGURE_NAMES

format_option = click.option(
    "--format",
    "style",
    type=click.Choice(["table", "csv", "json"]),
    default="table",
    show_default=True,
)


@click.command()
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@select_option
@click.option("--where", metavar="EXPRESSION", help="Keep the designs for which this holds.")
@click.option(
    "--sort",
    multiple=True,
    metavar="NAME",
    help="Sort by a variable, ascending; -NAME descends. Repeatable.",
)
@click.option("--columns", metavar="NAMES", help="Columns to show, separated by commas.")
@format_option
@explains_bad_input
def query(
    cubes: tuple[Path, ...],
    selections: tuple[str, ...],
    where: str | None,
    sort: tuple[str, ...],
    columns: str | None,
    style: str,
) -> None:
    """List the designs of CUBES, simulated and measured.

    Variables along the applied strain appear once it is selected: --select applied_strain=0.15
    """
    from knitlab.cube.cube_file import open_cube
    from knitlab.cube.query import formatted, query_cubes

    # A comma within brackets belongs to a reduction such as mean(poisson_ratio, 0.05:0.25).
    names = [name.strip() for name in re.split(r",(?![^(]*\))", columns)] if columns else None
    opened = [open_cube(cube, lazily=True) for cube in cubes]
    table = query_cubes(opened, read_selections(selections), where, sort, names)
    click.echo(formatted(table, style))


@click.command()
@click.argument("simulation", type=click.Path(path_type=Path))
@click.argument("experiments", type=click.Path(path_type=Path), nargs=-1, required=True)
@select_option
@format_option
@explains_bad_input
def compare(
    simulation: Path, experiments: tuple[Path, ...], selections: tuple[str, ...], style: str
) -> None:
    """Compare SIMULATION with EXPERIMENTS, curve by curve.

    The uncertainty is that of the RMS difference, from the scatter of the records; the noise
    is the RMS difference expected for equal curves.
    """
    from knitlab.api.comparison import compare as compare_with
    from knitlab.cube.query import formatted

    table = compare_with(simulation, *experiments, **read_selections(selections))
    click.echo(formatted(table, style))


@click.command(
    name="map",
    help="Draw a figure of KIND from CUBES, most kinds take one.\n\nKIND is one of "
    f"{', '.join(FIGURE_NAMES)}.",
)
@click.argument("kind")
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File to draw; its suffix (.pdf, .svg, .png; .gif for folding) sets the format.",
)
@click.option("--x", metavar="DIM", help="Dimension across a grid.")
@click.option("--y", metavar="DIM", help="Dimension up a grid.")
@click.option("--of", metavar="NAME", help="Variable whose values grid and swept show.")
@click.option(
    "--window", metavar="STRAIN:STRAIN", help="Strains over which sensor shows slope and linearity."
)
@select_option
@explains_bad_input
def draw_map(
    kind: str,
    cubes: tuple[Path, ...],
    output: Path,
    selections: tuple[str, ...],
    **shown: str | None,
) -> None:
    """Draw a figure of a cube, unless its file is up to date."""
    from knitlab.figures.drawn import fingerprint_of_figure, is_drawn

    chosen = read_selections(selections)
    options = {name: value for name, value in shown.items() if value is not None}
    with suppress(OSError):  # draw_figure explains why a cube cannot be read
        if is_drawn(output, fingerprint_of_figure(kind, cubes, chosen, options)):
            click.echo(f"figure  {output}")
            return
    from knitlab.figures.drawing import draw_figure

    click.echo(f"figure  {draw_figure(kind, cubes, output, chosen, options)}")


@click.command()
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@select_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Report to write: .html contains its figures; .md has them in a folder beside it.",
)
@explains_bad_input
def claims(cubes: tuple[Path, ...], selections: tuple[str, ...], output: Path | None) -> None:
    """Judge the paper's claims by CUBES: each claim holds, fails, or is not measured.

    The margin is the distance from the threshold of a claim, below 0 if it fails; from -0.25 to 0
    it is a near miss. If several cubes measure a claim, the one with the paper's samples decides
    it: clamped before periodic, then with more of the designs, then with more unit cells.
    """
    from knitlab.figures.report.page import check_suffix, write_page
    from knitlab.validation.claims import read_claims
    from knitlab.validation.judgement import judged, listed

    if output is not None:
        check_suffix(output)
    chosen = read_selections(selections)
    judgements = judged(read_claims(), cubes, chosen)
    click.echo(listed(judgements))
    if output is not None:
        files, faults = write_page(judgements, output, chosen)
        for path in files:
            click.echo(f"{'page' if path == output else 'figure':6}  {path}")
        for fault in faults:
            click.echo(f"knitlab: {fault}", err=True)
