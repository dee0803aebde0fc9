"""The command ``sensing``: several electrodes, cross-talk, strain and bending."""

from pathlib import Path
from typing import Any

import click

import knitlab as kl
from knitlab.cli import options
from knitlab.cli.options import flag, option, repeatable


@click.command()
@click.argument("cube", type=options.CUBE)
@options.select
@options.where
@option("--along", "Direction that the sensor is to read.", ["warp", "weft"], default="warp")
@flag("--free", "Cloth with free sides, not held as on a skin.")
@repeatable("--electrode electrodes NAME", "Capacitance matrix of these: w1, c2, w1+w3, 0:4/2:6.")
@repeatable("--sensor sensors NAME-NAME", "Cross-talk of these pairs of electrodes.")
@option("--pull", "Direction of the pull at one sensor.", ["weft", "warp"], default="weft")
@flag("--grounded", "Ground the electrodes that are not read; otherwise they float.")
@option("--cloth-permittivity", "Of the cloth, relative.", click.FLOAT, default=1.0)
@option("--cloth-thickness", "Of the cloth that has it [mm].", click.FLOAT, default=0.5)
@options.table_format
@options.output("Figure to draw", options.FIGURES, "a figure")
def sensing(
    cube: Path,
    selections: dict[str, Any],
    where: str | None,
    along: str,
    free: bool,
    electrodes: tuple[str, ...],
    sensors: tuple[str, ...],
    pull: str,
    grounded: bool,
    style: str,
    output: Path | None,
    **cloth: float,
) -> None:
    """List what the knitted capacitors of CUBE read of strain and bending, along and across.

    Numbers are changes of ln C: per strain, along and across the sensor, and per curvature in mm,
    bent along and across. selectivity is the first over the second. Shapes are in the case files
    beside a cube.

    With --electrode it prints the capacitance matrix of one design [pF], with --sensor what one
    sensor reads while another is pulled. Electrodes are ridges along a wale (w1, w2, …) or a course
    (c1, …), joined by +, or grid cells (columns 0:4 / rows 2:6).
    Exit code 1 if nothing is known of a state.
    """
    if electrodes and sensors:
        raise click.UsageError("--electrode and --sensor give a table each; give one of them")
    if (electrodes or sensors) and where:
        raise click.UsageError("--where is for a table of designs; select one design instead")
    options.check_selected(cube, selections, where)
    if electrodes:
        matrix = kl.capacitance_matrix(cube, electrodes, selections, output=output, **cloth)
        wide = matrix["capacitance"].to_dataframe()["capacitance"].unstack("to")
        table = wide[list(electrodes)].reindex(list(electrodes), level="electrode").reset_index()
        known = bool(matrix["capacitance"].notnull().all())
    elif sensors:
        pairs = [(one, other) for one, _, other in (each.partition("-") for each in sensors)]
        others: Any = "grounded" if grounded else "floating"
        readings = kl.cross_talk(
            cube, pairs, selections, pull=pull, others=others, output=output, **cloth
        )
        table = readings.to_dataframe().reset_index()
        known = bool(readings["reading"].notnull().all())
    else:
        from knitlab.api.sensing import selectivity_table

        found = kl.selectivity(cube, output, selections, along=along, where=where)
        table = selectivity_table(found, cube, free=free, marks=style == "table")
        known = bool((table["status"] == "ok").all())
    options.show(table, style, output)
    options.exit_unless(known)


COMMANDS = (sensing,)
