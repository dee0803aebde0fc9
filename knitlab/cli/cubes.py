"""Of cubes: ``query``, ``find``, ``compare``, ``map``, ``claims``, ``plate``, ``explore``."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from knitlab.cli import options
from knitlab.cli.options import COUNT, FILE, PATH, flag, option, repeatable
from knitlab.runs.figure_names import FIGURE_NAMES, check_figure_suffix

uncertainty_of = option(
    "--uncertainty-of",
    "Uncertainty of a new swatch, or of the mean stripe. [default: swatch, if repeats are known]",
    ["swatch", "mean"],
)


@click.command()
@options.cubes
@options.select
@options.where
@repeatable("--sort NAME", "Sort by a variable, ascending; -NAME descends.")
@option("--columns NAMES", "Columns to show, separated by commas; all shows every one.")
@flag("--list listed", "List the variables, with unit and meaning.")
@options.table_format
def query(
    cubes: tuple[Path, ...],
    selections: dict[str, Any],
    where: str | None,
    sort: tuple[str, ...],
    columns: str | None,
    listed: bool,
    style: str,
) -> None:
    """List the designs of CUBES, simulated and measured.

    Variables along the applied strain appear once it is selected: --select applied_strain=0.15.
    A table has the columns that answer most questions, and those of conditions; csv and json have
    all.
    """
    from knitlab.cubes.cube_file import open_cube
    from knitlab.cubes.query import main_columns, marks_of_all, query_cubes, variables_table

    # A comma within brackets belongs to a reduction such as mean(poisson_ratio, 0.05:0.25).
    parts = re.findall(r"(?:\([^)]*\)?|[^,(])+", columns or "")
    names = [*dict.fromkeys(part.strip() for part in parts)]
    opened = [open_cube(cube, lazily=True) for cube in cubes]
    if listed:
        options.show(variables_table(opened), style)
        return
    shown = None if names in ([], ["all"]) else names
    table = query_cubes(opened, selections, where, sort, shown)
    if not names and style == "table":
        asked = re.findall(r"\w+", f"{where or ''} {' '.join(sort)}")
        table = table[main_columns(table, [name for name in asked if name in table])]
    marks: Iterable[str] = ()
    if style == "table":
        marks = marks_of_all(opened, selections, list(table.columns))[table.index]
    options.show_models(opened)
    options.show(table, style, marks=marks)


@click.command()
@options.cubes
@repeatable(
    "--target targets TARGET", 'Target, such as "poisson_ratio = -0.3 @ 0.05:0.25".', required=True
)
@repeatable("--subject-to TARGET", 'Target that must be met, such as "knit_cell_x < 20".')
@option("--most", "Designs to list.", COUNT, default=10)
@option(
    "--material FILE",
    "Rank by the probability of meeting the targets, by the covariances in FILE.",
    FILE,
)
@uncertainty_of
@options.table_format
@options.output("Figure of the targets and the nearest designs, .pdf, .svg or .png.")
def find(cubes: tuple[Path, ...], style: str, output: Path | None, **wanted: Any) -> None:
    """List the designs of CUBES that come closest to the targets; nothing is simulated.

    A target is NAME = VALUE, NAME < VALUE, NAME > VALUE or VALUE < NAME < VALUE. A variable along
    the applied strain needs @ STRAIN or @ FROM:TO, and may be reduced over a window: mean(NAME),
    min, max, slope, linearity or spread. VALUE ± TOLERANCE gives the unit of distance; by default
    that is the scatter among the designs.
    """
    from knitlab.api import cubes as api

    check_figure_suffix(output)
    opened = [api.opened(cube, lazily=True) for cube in cubes]
    nearest = api.find(*opened, **wanted)
    options.show_models(opened)
    if style == "table":
        for number, reached in enumerate(nearest.reached, start=1):
            click.echo(f"target {number}: {reached.target.text}")
    if nearest.uncertainty:
        click.echo(f"probability: {nearest.uncertainty}", err=style != "table")
    options.show(nearest.table, style, marks=nearest.marks)
    for reason, count in nearest.passed_over.items():
        click.echo(f"{count} designs {reason}", err=True)
    if output is not None and len(nearest.table):
        from knitlab.figures.figure_files import draw_into
        from knitlab.figures.nearest_designs import nearest_figure

        draw_into(lambda: nearest_figure(nearest), output)
        click.echo(f"figure  {output}", err=True)


@click.command()
@click.argument("simulation", type=PATH)
@click.argument("experiments", type=PATH, nargs=-1, required=True)
@options.select
@options.table_format
def compare(
    simulation: Path, experiments: tuple[Path, ...], selections: dict[str, Any], style: str
) -> None:
    """Compare SIMULATION with EXPERIMENTS, curve by curve.

    The uncertainty is that of the RMS difference, from the scatter of the records; the noise
    is the RMS difference expected for equal curves.
    """
    from knitlab.api import cubes as api

    options.show(api.compare(simulation, *experiments, **selections), style)


@click.command(
    name="map",
    help="Draw a figure of KIND from CUBES, most kinds take one.\n\nKIND is one of "
    f"{', '.join(FIGURE_NAMES)}.",
)
@click.argument("kind")
@options.cubes
@options.output("File to draw; its suffix (.pdf, .svg, .png) sets the format.", required=True)
@option("--x DIM", "Dimension across a grid.")
@option("--y DIM", "Dimension up a grid.")
@option("--of NAME", "Variable whose values grid and swept show.")
@option("--window STRAIN:STRAIN", "Strains over which sensor shows slope and linearity.")
@option("--material FILE", "Material file with the covariances of stripes, for uncertainty.", FILE)
@uncertainty_of
@options.select
def draw_map(
    kind: str,
    cubes: tuple[Path, ...],
    output: Path,
    selections: dict[str, Any],
    **shown: str | Path | None,
) -> None:
    """Draw a figure of a cube, unless its file is up to date."""
    from knitlab.cubes.cube_file import open_cube
    from knitlab.figures.drawing import draw_figure

    chosen = {name: str(value) for name, value in shown.items() if value is not None}
    path = draw_figure(kind, cubes, output, selections, chosen)
    options.show_models([open_cube(cube, lazily=True) for cube in cubes])
    click.echo(f"figure  {path}")


@click.command()
@options.cubes
@options.select
@options.output("Report to write, .md, with its figures in a folder beside it.")
def claims(cubes: tuple[Path, ...], selections: dict[str, Any], output: Path | None) -> None:
    """Judge the paper's claims by CUBES: each claim holds, fails, or is not measured.

    The margin is the distance from the threshold of a claim, below 0 if it fails; from -0.25 to 0
    it is a near miss. If several cubes measure a claim, the one with the paper's samples decides
    it: clamped before periodic, then with more of the designs, then with more unit cells. Claims
    about relaxed fabric are decided by fabric at rest, if there is any.
    """
    from knitlab.claims.claims import read_claims
    from knitlab.claims.judgement import judged, listed
    from knitlab.figures.claims_page import check_suffix, write_page

    if output is not None:
        check_suffix(output)
    judgements = judged(read_claims(), cubes, selections)
    click.echo(listed(judgements))
    if output is not None:
        files, mistakes = write_page(judgements, output, selections)
        for path in files:
            click.echo(f"{'page' if path == output else 'figure':6}  {path}")
        options.echo_report([], warnings=mistakes)


@click.command()
@options.cubes
@options.output("The page; it is one file.", default=Path("explorer.html"))
def explore(cubes: tuple[Path, ...], output: Path) -> None:
    """Write a page on which CUBES can be explored in a browser, without a network.

    It shows a design map, curves with their bands, and shapes that turn; designs without a case
    file beside their cube have no shape. Its other tab is the report of the run.
    """
    from knitlab.api import cubes as api

    opened = [api.opened(cube) for cube in cubes]
    options.show_models(opened)
    click.echo(f"page    {api.explore(*opened, output=output)}")
    click.echo(f"{output.stat().st_size / 1e6:.1f} MB", err=True)


@click.command()
@click.argument("cube", type=options.PATH)
@options.select
@options.where
@options.table_format
@options.output(
    "File to write: .inp card of Abaqus for one state, .json card of all states, .csv table."
)
def plate(
    cube: Path, selections: dict[str, Any], where: str | None, style: str, output: Path | None
) -> None:
    """List the stiffness of the periodic fabric of CUBE as a plate, for shell elements.

    Shapes are in the case files beside a cube. 1 is x along the courses (weft), 2 is y along the
    wales (warp), along which tests pull by default. A is in N/mm, B in N and D in N mm, over the
    width. csv and json have all entries and the forces in the state.
    Exit code 1 if a state has no positive definite stiffness.
    """
    from knitlab.api.plates import plate_stiffness
    from knitlab.export.plates.shell_cards import MAIN_COLUMNS, plates_table

    table = plates_table(plate_stiffness(cube, output, selections, where=where))
    if style == "table":
        first = list(table.columns[: list(table.columns).index("status") + 1])
        table = table[[*first, *MAIN_COLUMNS]]
    options.show(table, style, output, "card")
    options.exit_unless(bool((table["status"] == "ok").all()))


COMMANDS = (query, find, compare, draw_map, claims, explore, plate)
