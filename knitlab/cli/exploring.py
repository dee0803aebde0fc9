"""The command ``explore``."""

from pathlib import Path

import click

from knitlab.cli.options import explains_bad_input


@click.command()
@click.argument("cubes", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("explorer.html"),
    show_default=True,
    help="The page; it is one file.",
)
@explains_bad_input
def explore(cubes: tuple[Path, ...], output: Path) -> None:
    """Write a page on which CUBES can be explored in a browser, without a network.

    It shows a design map, curves with their bands, and shapes that turn; designs without a case
    file beside their cube have no shape. Its other tab is the report of the run.
    """
    from knitlab.api.explorer import explore as write

    page = write(*cubes, output=output)
    click.echo(f"page    {page}")
    click.echo(f"{page.stat().st_size / 1e6:.1f} MB", err=True)
