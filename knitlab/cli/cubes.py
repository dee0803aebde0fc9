"""Of cubes: ``query``, ``find``, ``compare``, ``map``, ``claims``, ``plate``, ``explore``."""

from pathlib import Path
from typing import Any

import click

import knitlab as kl
from knitlab.cli import options
from knitlab.cli.options import COUNT, flag, option, repeatable
from knitlab.io.errors import invalid, unknown

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
    if listed:
        options.show(kl.variables(*cubes), style)
        return
    is_table = style == "table"
    if columns == "all":
        columns = None
    elif not columns:
        columns = "main" if is_table else None
    table = kl.query(
        *cubes, where=where, sort=sort, columns=columns, marks=is_table, selections=selections
    )
    options.show(table, style)


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
    options.EXISTING,
)
@uncertainty_of
@options.table_format
@options.output("Figure of the targets and the nearest designs", options.FIGURES, "a figure")
def find(cubes: tuple[Path, ...], style: str, output: Path | None, **wanted: Any) -> None:
    """List the designs of CUBES that come closest to the targets; nothing is simulated.

    A target is NAME = VALUE, NAME < VALUE, NAME > VALUE or VALUE < NAME < VALUE. A variable along
    the applied strain needs @ STRAIN or @ FROM:TO, and may be reduced over a window: mean(NAME),
    min, max, slope, linearity or spread. VALUE ± TOLERANCE gives the unit of distance; by default
    that is the scatter among the designs.
    """
    found = kl.find(*cubes, output=output, **wanted)
    is_table = style == "table"
    heading = []
    if is_table:
        for number, reached in enumerate(found.reached, start=1):
            heading.append(f"target {number}: {reached.target.text}")
    if found.uncertainty:
        heading.append(f"probability: {found.uncertainty}")
    drawn = output if len(found.table) else None
    table = found.marked_table if is_table else found.table
    options.show(table, style, drawn, heading=heading)
    for reason, count in found.excluded.items():
        click.echo(f"{count} designs {reason}", err=True)


@click.command()
@click.argument("simulation", type=options.CUBE)
@click.argument("experiments", type=options.CUBE, nargs=-1, required=True)
@options.select
@options.table_format
def compare(
    simulation: Path, experiments: tuple[Path, ...], selections: dict[str, Any], style: str
) -> None:
    """Compare SIMULATION with EXPERIMENTS, curve by curve.

    The uncertainty is that of the RMS difference, from the scatter of the records; the noise
    is the RMS difference expected for equal curves.
    """
    options.show(kl.compare(simulation, *experiments, selections=selections), style)


class FigureCommand(click.Command):
    """A command whose help lists every figure."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what each figure shows."""
        with formatter.section("Kinds"):
            formatter.write_dl(list(kl.figures().items()))


def _known(_: Any, __: Any, kind: str) -> str:
    if kind not in kl.plot.__all__:
        raise invalid("kind", unknown(kind, kl.plot.__all__, "figure"))
    return kind


@click.command(name="map", cls=FigureCommand)
@click.argument("kind", callback=_known, is_eager=True)
@options.cubes
@options.output("File to draw", options.FIGURES, "a figure", required=True)
@option("--x DIM", "Dimension across a grid.")
@option("--y DIM", "Dimension up a grid.")
@option("--of NAME", "Variable whose values grid and swept show.")
@option("--window STRAIN:STRAIN", "Strains over which sensor shows slope and linearity.")
@option("--material FILE", "With the covariances of stripes, for uncertainty.", options.EXISTING)
@uncertainty_of
@options.select
def draw_map(
    kind: str,
    cubes: tuple[Path, ...],
    output: Path,
    selections: dict[str, Any],
    **shown: str | Path | None,
) -> None:
    """Draw a figure of KIND from CUBES, unless its file is up to date; most kinds take one cube.

    The suffix of the file sets its format.
    """
    path = kl.draw(kind, *cubes, output=output, selections=selections, **shown)
    options.show_models(cubes)
    click.echo(f"figure  {path}")


@click.command()
@options.cubes
@options.select
@options.output(
    "Report to write, with its figures in a folder beside it", [".md"], "a page of Markdown"
)
def claims(cubes: tuple[Path, ...], selections: dict[str, Any], output: Path | None) -> None:
    """Judge the paper's claims by CUBES: each claim holds, fails, or is not measured.

    The margin is the distance from the threshold of a claim, below 0 if it fails; from -0.25 to 0
    it is a near miss. If several cubes measure a claim, the one with the paper's samples decides
    it: clamped before periodic, then with more of the designs, then with more unit cells. Claims
    about relaxed fabric are decided by fabric at rest, if there is any.
    """
    from knitlab.api.cubes import judge_claims

    judged = judge_claims(cubes, output, selections)
    click.echo(judged.lines)
    for path in judged.files:
        click.echo(f"{'page' if path == output else 'figure':6}  {path}")
    options.echo_report([], warnings=judged.mistakes)


@click.command()
@options.cubes
@options.output("The page; it is one file", [".html"], "a page", default=Path("explorer.html"))
def explore(cubes: tuple[Path, ...], output: Path) -> None:
    """Write a page on which CUBES can be explored in a browser, without a network.

    It shows a design map, curves with their bands, and shapes that turn; designs without a case
    file beside their cube have no shape. Its other tab is the report of the run.
    """
    page = kl.explore(*cubes, output=output)
    options.show_models(cubes)
    click.echo(f"page    {page}")
    click.echo(f"{output.stat().st_size / 1e6:.1f} MB", err=True)


@click.command()
@click.argument("cube", type=options.CUBE)
@options.select
@options.where
@options.table_format
@options.output(
    "File to write, .inp for a card of Abaqus of one state, .json for one of all states",
    [".inp", ".json", ".csv"],
    "a card",
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
    options.check_selected(cube, selections, where)
    from knitlab.api.export import plates_table

    plates = kl.plate_stiffness(cube, output, selections, where=where)
    table = plates_table(plates, main=style == "table")
    options.show(table, style, output, "card")
    options.exit_unless(bool((table["status"] == "ok").all()))


@click.command()
@click.argument("cube", type=options.CUBE)
@options.select
@options.table_format
@options.output(
    "File to write, .py for functions, .csv for stress over strains, or a figure",
    [".py", ".csv", *options.FIGURES],
    "a law",
)
def law(cube: Path, selections: dict[str, Any], style: str, output: Path | None) -> None:
    """Fit an energy density of a membrane to the tests in CUBE, and list its errors at each.

    A test left out is predicted by a law that is fitted to the others; where these enclose it the
    errors say how well the law predicts other loads. The workflow law runs such tests.
    """
    options.check_selected(cube, selections)
    fitted = kl.law(cube, output, selections)
    options.show(fitted.errors, style, output, "law")


COMMANDS = (query, find, compare, draw_map, claims, explore, plate, law)
