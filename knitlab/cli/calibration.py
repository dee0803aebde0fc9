"""The command ``calibrate``."""

import sys
from pathlib import Path
from typing import Literal

import click

from knitlab.cli.options import SOME_CASE_NOT_OK, check_toml, explains_bad_input

MILLIMETRES = click.FloatRange(min=0, min_open=True, max=1e6)


@click.command()
@click.argument("curve", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--stripe", "knit", type=click.Choice(["rib", "garter"]), required=True)
@click.option(
    "-n", "stitches", type=click.IntRange(min=1), required=True, help="Stitches across the stripe."
)
@click.option(
    "--period", type=MILLIMETRES, required=True, help="Relaxed peak-to-peak distance [mm]."
)
@click.option(
    "--cell-size",
    type=click.Choice(["flat", "relaxed"]),
    help="Model option to simulate the stripe with. [default: that of params/reading.toml]",
)
@click.option("--width", type=MILLIMETRES, help="Width of one row, for a curve of stress [mm].")
@click.option(
    "--thickness", type=MILLIMETRES, help="Thickness of the fabric, for stress over area [mm]."
)
@click.option(
    "--law",
    type=click.Choice(["linear", "stiffening", "tabulated"]),
    default="linear",
    show_default=True,
    help="How the force of a spring grows; others are compared with linear.",
)
@click.option(
    "--spring-curve",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Measured curve of a spring, from strain 0, for --law tabulated; its shape counts. CSV.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Stripe entry to write, .toml, with figures beside it. [default: STRIPE-N.toml]",
)
@explains_bad_input
def calibrate(
    curve: Path,
    knit: Literal["rib", "garter"],
    stitches: int,
    period: float,
    cell_size: Literal["flat", "relaxed"] | None,
    width: float | None,
    thickness: float | None,
    law: Literal["linear", "stiffening", "tabulated"],
    spring_curve: Path | None,
    output: Path | None,
) -> None:
    """Fit k_s, k_t and theta_0 of a stripe to the tension CURVE of its pure fabric.

    CURVE is a CSV file with a header such as "strain [1],force [N]": the force on one row of the
    network, or the stress with the row's --width. Measure until the folds are open and the springs
    stretch, to about 200 % strain: below that the three cannot be determined separately.
    """
    from knitlab.io.errors import fault
    from knitlab.io.table_file import read_tension_curve

    output = output or Path(f"{knit}-{stitches}.toml")
    check_toml(output)
    if (law == "tabulated") != (spring_curve is not None):
        problem = "goes with --law tabulated; give both, or neither"
        raise fault("--spring-curve", problem)
    measured = read_tension_curve(curve, width, thickness)

    from knitlab.fabric.spring_law import SpringCurve
    from knitlab.figures.calibration import calibration_figure
    from knitlab.figures.saving import save
    from knitlab.figures.style import print_style
    from knitlab.measure.calibration import calibrate as fit
    from knitlab.measure.calibration import report, report_comparison
    from knitlab.measure.stripe_file import write_stripe_file
    from knitlab.sweep.parameters import defaults

    title = f"{stitches} × {stitches} {knit}, period {period:g} mm"
    springs: Literal["linear", "stiffening"] | SpringCurve = "linear"
    if spring_curve is not None:
        table = read_tension_curve(spring_curve)
        try:
            springs = SpringCurve(tuple(table.strain.tolist()), tuple(table.force.tolist()))
        except ValueError as error:
            raise fault(str(spring_curve), str(error)) from error
    elif law == "stiffening":
        springs = "stiffening"
    try:
        found = fit(period, measured.strain, measured.force, springs)
        linear = None if law == "linear" else fit(period, measured.strain, measured.force)
    except ValueError as error:
        raise fault(str(curve), str(error)) from error
    click.echo(title)
    for line in [*report(found), *(report_comparison(found, linear) if linear else [])]:
        click.echo(line)
    for warning in found.warnings:
        click.echo(f"knitlab: {warning}", err=True)
    if found.usable:
        used_size = cell_size or defaults().model.cell_size
        write_stripe_file(output, knit, stitches, found, curve, used_size)
        click.echo(f"stripe   {output}")
    else:
        click.echo("knitlab: no stripe is written, as this fit cannot be used", err=True)
    with print_style():
        figure = calibration_figure(
            found.strain,
            found.force,
            found.fitted_force,
            title,
            None if linear is None else linear.fitted_force,
        )
        for suffix in (".pdf", ".png"):
            save(figure, output.with_suffix(suffix))
            click.echo(f"figure   {output.with_suffix(suffix)}")
    if not found.usable:
        sys.exit(SOME_CASE_NOT_OK)
