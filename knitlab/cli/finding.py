"""The command ``find``."""

from pathlib import Path

import click

from knitlab.cli.cubes import format_option
from knitlab.cli.options import explains_bad_input


@click.command()
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "--target",
    "targets",
    multiple=True,
    required=True,
    metavar="TARGET",
    help='Target, such as "poisson_ratio = -0.3 @ 0.05:0.25". Repeatable.',
)
@click.option(
    "--subject-to",
    multiple=True,
    metavar="TARGET",
    help='Target that must be met, such as "knit_cell_x < 20". Repeatable.',
)
@click.option(
    "--most", type=click.IntRange(min=1), default=10, show_default=True, help="Designs to list."
)
@format_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Figure of the targets and the nearest designs, .pdf, .svg or .png.",
)
@explains_bad_input
def find(
    cubes: tuple[Path, ...],
    targets: tuple[str, ...],
    subject_to: tuple[str, ...],
    most: int,
    style: str,
    output: Path | None,
) -> None:
    """List the designs of CUBES that come closest to the targets; nothing is simulated.

    A target is NAME = VALUE, NAME < VALUE, NAME > VALUE or VALUE < NAME < VALUE. A variable along
    the applied strain needs @ STRAIN or @ FROM:TO, and may be reduced over a window: mean(NAME),
    min, max, slope, linearity or spread. VALUE ± TOLERANCE gives the unit of distance; by default
    that is the scatter among the designs.
    """
    from knitlab.api.finding import find as find_in
    from knitlab.cube.query import formatted
    from knitlab.sweep.figure_names import check_still

    if output is not None:
        check_still(output)
    found = find_in(*cubes, targets=targets, subject_to=subject_to, most=most)
    if style == "table":
        for number, reached in enumerate(found.reached, start=1):
            click.echo(f"target {number}: {reached.target.text}")
    click.echo(formatted(found.table, style))
    for reason, count in found.passed_over.items():
        click.echo(f"{count} designs {reason}", err=True)
    if output is not None and len(found.table):
        from knitlab.figures.figure_files import save
        from knitlab.figures.found_designs import found_figure
        from knitlab.figures.style import print_style

        with print_style():
            save(found_figure(found), output)
        click.echo(f"figure  {output}", err=True)
