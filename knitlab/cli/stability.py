"""Commands on the stability of one design: ``branches``, ``shapes``."""

from pathlib import Path

import click

import knitlab as kl
from knitlab.cli import options
from knitlab.cli.options import COUNT, option

figure = options.output("Figure to draw", options.FIGURES, "a figure")


@click.command()
@click.argument("workflow", default="periodic")
@options.settings
@options.table_format
@figure
def branches(workflow: str, settings: tuple[str, ...], style: str, output: Path | None) -> None:
    """Follow the equilibria of one design of WORKFLOW through the points at which it snaps.

    --set n_stripe=4 --set n_subunit=16 choose the design, --set strain_max the largest strain.
    WORKFLOW is periodic by default.
    A row for each branch, limit point and branch point; csv and json have all points.
    """
    options.check_planned(workflow, settings)
    points = kl.branches(workflow, settings, output=output).to_dataframe()
    if style == "table":
        last = ~points["branch"].duplicated(keep="last") | ~points["branch"].duplicated()
        points = points[last | (points["kind"] != "regular")]
    options.show(points, style, output)


@click.command()
@click.argument("workflow", default="periodic")
@options.settings
@option("--starts", "Number of sheets to relax, each with other noise.", COUNT, default=30)
@options.table_format
@figure
def shapes(
    workflow: str, settings: tuple[str, ...], starts: int, style: str, output: Path | None
) -> None:
    """List the shapes that one design of WORKFLOW may relax to, and the energies between them.

    Energies are in N mm (mJ), lengths in mm of the network. WORKFLOW is periodic by default.

    Exit code 1 if a start did not converge.
    """
    options.check_planned(workflow, settings)
    atlas = kl.shapes(workflow, settings, starts=starts, output=output)
    table = atlas.drop_vars(["height", "barrier", "to"]).to_dataframe().reset_index()
    table.insert(2, "above_lowest", table["energy"] - table["energy"].min())
    for other in atlas["to"].values:
        if atlas["barrier"].sel(to=other).notnull().any():
            table[f"energy_to_{other}"] = atlas["barrier"].sel(to=other).values
    options.show(table, style, output)
    if failed := atlas.attrs["not_converged"]:
        options.echo_error(f"{failed} of {starts} starts did not converge and are left out")
    options.exit_unless(not failed)


COMMANDS = (branches, shapes)
