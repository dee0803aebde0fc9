"""Commands on measurements: ``calibrate``, ``import``, ``fit``."""

import time
from pathlib import Path
from typing import Any

import click

from knitlab.cli import options
from knitlab.cli.options import COUNT, POSITIVE, option


class Zero(click.ParamType):
    """The force to subtract: ``none``, ``start``, or a number of newtons."""

    name = "none|start|N"

    def convert(self, value: Any, *about: Any) -> Any:
        """Return the word, or the number of newtons."""
        try:
            return value if value in ("none", "start") else float(value)
        except ValueError:
            self.fail(f"{value!r} is not none, start or a number of newtons", *about)


MILLIMETRES = click.FloatRange(min=0, min_open=True, max=1e6)


@click.command()
@click.argument("record", type=options.EXISTING)
@option("--stripe knit", kind=["rib", "garter"], required=True)
@option("-n stitches", "Stitches across the stripe.", COUNT, required=True)
@option("--period", "Relaxed peak-to-peak distance [mm].", MILLIMETRES)
@option("--gauge-length", "Relaxed length between the clamps [mm].", MILLIMETRES)
@option("--gauge-stitches", "Stitches along the gauge length; they give the period.", POSITIVE)
@option("--width", "Width of the swatch that the force pulls [mm].", MILLIMETRES)
@option("--along", "Record of the same fabric pulled along its ridges. CSV.", options.EXISTING)
@option("--along-width", "Width of the swatch of --along [mm]. [default: --width]", MILLIMETRES)
@option("--along-gauge-length", "Its gauge length [mm]. [default: --gauge-length]", MILLIMETRES)
@option("--thickness", "Thickness of the fabric, for stress over area [mm].", MILLIMETRES)
@option(
    "--zero",
    "Subtract from the force: nothing, the force at zero strain, or N newtons.",
    Zero(),
    metavar="none|start|N",
)
@option("--preload", "Tension at which the record began [N].", POSITIVE)
@option("--cycle", "The cycle whose loading branch is taken.", COUNT, default=1)
@option("--decimal", "Decimal mark of the files, if their numbers do not show it.", [".", ","])
@option("--table", "Which table is read, of files with several. [default: all as repeats]", COUNT)
@option(
    "--cell-size",
    "Model option to simulate the stripe with. [default: that of params/model.toml]",
    ["flat", "relaxed"],
)
@option(
    "--law",
    "How the force of a spring grows; others are compared with linear.",
    ["linear", "stiffening", "tabulated"],
    default="linear",
)
@option(
    "--spring-curve",
    "Measured curve of a spring, from strain 0, for --law tabulated; its shape counts. CSV.",
    options.EXISTING,
)
@click.option("--accept", is_flag=True, help="Write the stripe even if it is undetermined.")
@click.option("--friction", is_flag=True, help="Fit friction and drift to all cycles and repeats.")
@options.output(
    "Material file to write, or to add the stripe to, with figures beside it",
    [".toml"],
    "a material",
    default=Path("material.toml"),
)
def calibrate(record: Path, knit: Any, stitches: int, **arguments: Any) -> None:
    """Fit k_s, k_t and theta_0 of a stripe to the RECORD of a tensile test of its pure fabric.

    RECORD is a CSV file with a header such as "repeat [1],extension [mm],force [N]": strain, or
    extension with --gauge-length, and the force on a swatch of this --width, or the stress. Of
    force and stress, --width reads the force and --thickness the stress. Several repeats, in a
    column or in tables below each other, give one curve; of cycles, one loading branch is taken.
    Without --width, the force is that on one row of the network. Pull until the folds are open and
    the springs stretch, to about 200 % strain: below that the three cannot be determined
    separately. --along adds the springs along the ridges; without it they are those of the other
    knit, and far too stiff. After the fit the swatch is simulated and compared with its record.
    """
    from knitlab.api.laboratory import calibrate_stripe

    result = calibrate_stripe(record, knit, stitches, **arguments)
    options.echo_report(result.report, result.warnings)
    if result.refusal:
        reason = result.refusal.replace("accept = True", "--accept")
        options.echo_error(f"no stripe is written, as {reason}")
    else:
        width = 14 if arguments["friction"] else 9
        click.echo(f"{'stripe':{width}}{knit} {stitches} in {arguments['output']}")
        if result.settings:
            settings = " ".join(f"--set {each}" for each in result.settings)
            click.echo(f"{'settings':{width}}{settings}")
    if result.figure is not None:
        click.echo(f"figure   {result.figure}")
    options.exit_unless(not result.refusal)


@click.command(name="import")
@click.argument("kind", type=click.Choice(["markers", "tensile", "capacitance"]))
@click.argument("description", type=options.EXISTING)
@options.results
def import_records(kind: Any, description: Path, results: Path) -> None:
    """Import laboratory records as a cube, to compare with simulations.

    They are described by DESCRIPTION, a TOML file: tracked markers, a tensile test, or the log of
    an LCR meter, by their KIND.
    """
    from knitlab.api.laboratory import import_records

    imported = import_records(kind, description, results)
    options.echo_report(imported.summary)
    click.echo(f"cube    {imported.path}")


@click.command()
@click.argument("experiment", type=options.CUBE)
@click.argument("workflow")
@options.settings
@options.select
@option(
    "--prior-std",
    "Relative standard deviation of the tabulated stripes.",
    click.FloatRange(0, 2, min_open=True),
    default=0.2,
)
@option("--looseness", "", click.FloatRange(0, 2, min_open=True), hidden=True)
@option(
    "--model-error",
    "Error of the model, as a fraction of the largest value of a curve.",
    click.FloatRange(0, 1),
    default=0.01,
)
@option(
    "--starts",
    "Largest number of starts to try until the test is matched.",
    click.IntRange(1, 64),
    default=4,
)
@options.output(
    "Stripes to write, with figures beside them",
    [".toml"],
    "stripes",
    default=Path("fitted.toml"),
)
def fit(
    experiment: Path,
    workflow: str,
    settings: tuple[str, ...],
    selections: dict[str, Any],
    looseness: float | None,
    output: Path,
    **arguments: Any,
) -> None:
    """Fit k_s, k_t and theta_0 of both stripes to an imported EXPERIMENT on a whole fabric.

    The sample is the only case of WORKFLOW with the design of the experiment. It is simulated
    about ten to fifty times; if interrupted, the same command continues.
    """
    if looseness is not None:
        options.echo_error("--looseness is now --prior-std, and will be removed")
        arguments["prior_std"] = looseness
    options.check_planned(workflow, settings)
    began = time.monotonic()

    def report_step(tests: int, chi_squared: float) -> None:
        if tests == 1:
            seconds = time.monotonic() - began
            click.echo(f"the first test took {seconds:.0f} s; usual are 10 to 50 tests", err=True)
        click.echo(f"test {tests}: chi² {chi_squared:.4g}", err=True)

    from knitlab.api import laboratory as api

    arguments |= {"selections": selections, "step": report_step, "output": output}
    fitted = api.fit(experiment, workflow, settings, **arguments)
    options.echo_report(fitted.report, fitted.warnings)
    click.echo(f"stripes  {output}")
    click.echo(f"figure   {output.with_suffix('.png')}")
    options.exit_unless(fitted.converged)


COMMANDS = (calibrate, import_records, fit)
