"""Commands towards a sample: ``design``, ``knit``, ``shape``, ``read``, ``export``, ``wear``."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

import knitlab as kl
from knitlab.cli import options
from knitlab.cli.options import COUNT, FILE, flag, option, repeatable
from knitlab.io.cube_path import is_cube
from knitlab.io.names import check_suffix

if TYPE_CHECKING:
    from knitlab.api.knitting import KnitSample


@contextmanager
def _continuable() -> Iterator[None]:
    """A search that keeps its simulations if it is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        click.echo("stopped: finished simulations are kept; run again to continue", err=True)
        sys.exit(options.SOME_CASE_NOT_OK)


@click.command()
@click.argument("file", metavar="TARGETS.toml", type=options.EXISTING)
@options.results
@option(
    "--budget N|MINUTESmin",
    "Largest number of simulations of coarse sweep and searches, or a time such as 30min.",
    default="60",
)
@options.workers(0)
@options.table_format
def design(file: Path, results: Path, budget: str, workers: int, style: str) -> None:
    """Find the stripes and sizes that come closest to the targets of a TOML file, by simulation.

    Writes a cube of the candidates, a workflow that reproduces each, a table of all trials, and
    figures into a folder with the name of the file. An interrupted design continues when it is
    run again.
    Exit code 1 if no candidate meets all targets.
    """
    with _continuable():
        designed = kl.design(file, budget=budget, workers=workers, results=results, figures=True)
    is_table = style == "table"
    if is_table:
        for number, target in enumerate(designed.request.wanted, start=1):
            kind = "target" if number <= len(designed.request.targets) else "subject to"
            click.echo(f"{kind} {number}: {target.text}")
    options.show(designed.ranking.marked_table if is_table else designed.table, style)
    for line in designed.summary():
        click.echo(line, err=not is_table)
    click.echo(f"cube    {designed.folder / 'cube.nc'}", err=True)
    for path in designed.workflows:
        click.echo(f"workflow  {path}", err=True)
    for path in sorted((designed.folder / "figures").glob("*.png")):
        click.echo(f"figure  {path}", err=True)
    options.exit_unless(designed.met)


_machine = repeatable(
    "--machine KEY=VALUE",
    "Machine of params/machine.toml, such as model=Kniterate, or a value of it, such as end=drop.",
)
_outputs = repeatable(
    "-o --output outputs",
    "File: .k knitout; .svg, .png or .pdf the stitch chart; .csv a table; .txt words for hands.",
    FILE,
)


def _check_outputs(outputs: tuple[Path, ...]) -> None:
    for path in outputs:
        check_suffix(path, (".k", ".csv", ".txt", *options.FIGURES), "knitout or a chart")


def _save(sample: "KnitSample", outputs: tuple[Path, ...], in_the_round: bool = False) -> None:
    for path in outputs:
        kind = {".k": "knitout", ".txt": "instructions"}.get(path.suffix, "chart")
        click.echo(f"{kind:13} {sample.save(path, in_the_round=in_the_round)}")


def _no_mistake(sample: "KnitSample") -> bool:
    """Check the program of a sample, and print what is found."""
    checked = sample.check()
    for note in checked.notes:
        click.echo(f"{'check':13} {note}")
    options.echo_first([f"knitlab: {mistake}" for mistake in checked.mistakes], err=True)
    return not checked.mistakes


@click.command()
@click.argument("design", metavar="DESIGN|CUBE")
@options.select
@options.settings
@options.repeats
@option("--needles", "Needles to fill with whole repeats, twice as long as wide.", COUNT)
@option(
    "--face",
    "Face of the fabric for conductors; by default that to which their ridges point.",
    ["front", "back"],
)
@_machine
@_outputs
@flag("--in-the-round", "Words for rounds, in place of rows to and fro.")
@repeatable("--sheet sheets", "File for the specification sheet, .pdf, .svg or .png.", FILE)
@flag("--check", "Check the knitout, and compare it with the chart.")
def knit(
    design: str,
    selections: dict[str, Any],
    settings: tuple[str, ...],
    outputs: tuple[Path, ...],
    in_the_round: bool,
    sheets: tuple[Path, ...],
    check: bool,
    **sample_options: Any,
) -> None:
    """Chart a design stitch by stitch, and write knitout for a machine.

    DESIGN is a workflow, by its name or file, that --set and --select narrow to one design. A CUBE
    also predicts the relaxed size and the Poisson's ratio of the sheet.
    Exit code 1 if the check finds a mistake.
    """
    _check_outputs(outputs)
    for path in sheets:
        check_suffix(path, options.FIGURES, "a figure")
    if not is_cube(design):
        options.check_planned(design, settings)
    sample = kl.knit(design, overrides=settings, selections=selections, **sample_options)
    for name, value in sample.rows():
        click.echo(f"{name:13} {value}")
    for warning in sample.warnings:
        click.echo(f"warning: {warning}", err=True)
    for remark in sample.remarks:
        click.echo(f"remark: {remark}", err=True)
    _save(sample, outputs, in_the_round)
    for path in sheets:
        click.echo(f"{'sheet':13} {sample.save_sheet(path)}")
    options.exit_unless(not check or _no_mistake(sample))


def _kind_of_rows(text: str) -> tuple[int, int] | Literal["plain"]:
    if text.strip() == "plain":
        return "plain"
    try:
        n_stripe, n_subunit = map(int, text.split(","))
    except ValueError as error:
        message = f"{text!r} is neither a design such as 8,32 nor plain"
        raise click.BadParameter(message) from error
    return n_stripe, n_subunit


@click.command()
@click.argument("target", metavar="TARGET", type=options.EXISTING)
@option(
    "--workflow",
    "Workflow with the model and the design, by its name or file, or a cube.",
    default="periodic",
)
@options.select
@options.settings
@option(
    "--border",
    "How patches end at the outline: cut along the grid, none is cut, or those cut are plain.",
    ["cut", "whole", "plain"],
    default="cut",
)
@option(
    "--stretch", "Applied strain at which the piece is to have the outline.", float, default=0.0
)
@repeatable(
    "--rows N_STRIPE,N_SUBUNIT|plain",
    "With a widening, a further kind of rows of patches that the piece may have.",
    callback=lambda _, __, texts: [_kind_of_rows(text) for text in texts],
)
@option("--rounds", "Largest number of pieces that are simulated.", COUNT, default=4)
@_machine
@options.results
@_outputs
@option("--figure", "File for a figure of the outline and of all rounds: .pdf, .svg or .png.", FILE)
@flag("--check", "Check the knitout, and compare it with the chart.")
def shape(
    target: Path,
    selections: dict[str, Any],
    settings: tuple[str, ...],
    outputs: tuple[Path, ...],
    figure: Path | None,
    check: bool,
    **search: Any,
) -> None:
    """Find the chart of a piece that relaxes to an outline, and write knitout for a machine.

    TARGET is a drawing (SVG, its size in mm) of one closed line, or a table of length [mm] and
    width [mm]. The whole piece is simulated and laid out again until its outline is nearer than a
    unit cell. Repeat the command to go on after an interruption.

    A column widening [1] in the table is the strain along the courses that the piece is to have
    when it is stretched: --stretch says by how much, --rows which rows it may have.
    Exit code 1 if no piece comes that near, or the check finds a mistake.
    """
    _check_outputs(outputs)
    if figure is not None:
        check_suffix(figure, options.FIGURES, "a figure")
    if not is_cube(search["workflow"]):
        options.check_planned(search["workflow"], settings)
    with _continuable():
        piece = kl.shape(target, overrides=settings, selections=selections, **search)
    for name, value in piece.rows():
        click.echo(f"{name:13} {value}")
    if figure is not None:
        click.echo(f"{'figure':13} {piece.save_figure(figure)}")
    _save(piece.sample, outputs)
    is_right = not check or _no_mistake(piece.sample)
    options.exit_unless(piece.fit.met and is_right)


@click.command("read")
@click.argument("chart", type=options.EXISTING)
@option(
    "--first",
    "Edge of a text or an image that is knitted first.",
    ["bottom", "top"],
    default="bottom",
)
@option("--carrier", "Of knitout, the carrier to read; by default that with most stitches.", COUNT)
@option("--knit SYMBOL", "Of a text or an image, the symbol or colour of a knit, such as ' '.")
@option("--purl SYMBOL", "Of a text or an image, the symbol or colour of a purl.")
@options.output("File for the pattern, for [design] pattern_files", [".toml"], "a pattern")
def read(
    chart: Path,
    first: Literal["bottom", "top"],
    carrier: int | None,
    knit: str | None,
    purl: str | None,
    output: Path | None,
) -> None:
    """Find the patches and stripes of any stitch CHART.

    CHART is rows of text (k 1 knit, p 0 - purl, seen from the front), a table of knitlab knit, an
    image with one pixel a stitch in two colours, the darker purl, or knitout (.k). A chart that can
    be read in several ways is refused; --knit and --purl say which is right.
    Exit code 1 if it has stitches that the model cannot represent; they are named.
    """
    from knitlab.api.knitting import pattern_name

    chart_read = kl.read_chart(chart, first=first, carrier=carrier, knit=knit, purl=purl)
    for name, value in chart_read.summary(kl.defaults().gauge):
        click.echo(f"{name:13} {value}")
    if output is not None:
        click.echo(f"{'pattern':13} {chart_read.save_pattern(output)}")
        settings = {"pattern_files": output, "pattern": pattern_name(output)}
        settings |= {"n_stripe": chart_read.n_stripe, "n_subunit": chart_read.n_subunit}
        if "G" in chart_read.letters:
            settings["garter_start"] = chart_read.garter_start
        given = " ".join(f"--set {name}={value}" for name, value in settings.items())
        click.echo(f"{'to run':13} knitlab run periodic {given}")
    options.echo_first([f"knitlab: {message}" for message in chart_read.messages], err=True)
    options.exit_unless(not chart_read.messages)


@click.command()
@click.argument("cube", type=options.CUBE)
@options.select
@options.output(
    "File to write; a series over the strain is .pvd or .fold",
    [".vtu", ".pvd", ".ply", ".obj", ".stl", ".glb", ".fold"],
    "a mesh",
    required=True,
)
@options.repeats
@flag("--triangles", "Divide every grid cell into two triangles.")
@option(
    "--thickness MM",
    "Thickness of a closed solid, to print; without it the mesh is an open sheet.",
    float,
)
def export(
    cube: Path, selections: dict[str, Any], output: Path, repeats: Any, **surface: Any
) -> None:
    """Write the shape of one design of CUBE as a mesh for other programs.

    Shapes are in the case files beside a cube. Of a single file the strain is 0 unless it is
    selected; a series has every strain that was reached.
    """
    options.check_selected(cube, selections)
    exported = kl.export(cube, output, selections, repeats=repeats or (1, 1), **surface)
    for strain, mesh, crossing in zip(
        exported.applied_strain, exported.meshes, exported.self_intersections, strict=True
    ):
        corners = {3: "triangles", 4: "quads"}[mesh.faces.shape[1]]
        size = " × ".join(f"{length:.3g}" for length in mesh.size)
        counts = f"{len(mesh.nodes)} nodes, {len(mesh.faces)} {corners}"
        crossed = f", {crossing} pairs of cells pass through each other" if crossing else ""
        click.echo(f"applied_strain {strain:g}: {counts}, {size} {exported.unit}{crossed}")
    click.echo(f"mesh    {exported.files[0]}")


@click.command()
@click.argument("cube", type=options.CUBE)
@option(
    "--limb FILE", "Table of height [mm] and circumference [mm].", options.EXISTING, required=True
)
@options.select
@option("--needles", "Needles around the limb.", COUNT)
@option("--pressure MMHG", "Pressure at the narrowest place, for which needles are found.", float)
@option("--compression-class", "Class at the narrowest place, such as ral-1, as --pressure.")
@option("--length-ratio", "Length along the limb over the relaxed one; free by default.", float)
@option("--thickness MM", "Thickness of the folded cloth; by default that of its shape.", float)
@option("--sensor CUBE", "Cube of the same design with electrodes, with load = weft.", options.CUBE)
@options.table_format
def wear(cube: Path, limb: Path, selections: dict[str, Any], style: str, **sleeve: Any) -> None:
    """List stretch, tension and pressure of a sleeve of the fabric of CUBE on a limb.

    The sleeve is knitted in the round, with courses around. CUBE has tests as of the workflow law.
    Exit code 1 if a place is stretched beyond the tests, or lies outside the class.
    """
    options.check_selected(cube, selections)
    table = kl.wear(cube, limb, selections, **sleeve)
    options.show(table, style)
    options.echo_report([], table.attrs["unread"])
    click.echo(f"needles {table.attrs['needles']}", err=style != "table")
    if "class" in table.attrs:
        click.echo(f"class   {table.attrs['class']}", err=style != "table")
    options.exit_unless(bool(table.filter(["between", "in_class"]).all(axis=None)))


COMMANDS = (design, knit, shape, read, export, wear)
