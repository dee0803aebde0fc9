"""Commands on measurements: ``calibrate``, ``import``, ``fit``."""

import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from knitlab.cli import options
from knitlab.cli.options import COUNT, FILE, PATH, POSITIVE, option
from knitlab.io.names import check_suffix
from knitlab.io.toml import TOML

if TYPE_CHECKING:
    from knitlab.lab.description import RecordKind


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
@click.argument("record", type=FILE)
@option("--stripe knit", kind=["rib", "garter"], required=True)
@option("-n stitches", "Stitches across the stripe.", COUNT, required=True)
@option("--period", "Relaxed peak-to-peak distance [mm].", MILLIMETRES)
@option("--gauge-length", "Relaxed length between the clamps [mm].", MILLIMETRES)
@option("--gauge-stitches", "Stitches along the gauge length; they give the period.", POSITIVE)
@option("--width", "Width of the swatch that the force pulls [mm].", MILLIMETRES)
@option("--along", "Record of the same fabric pulled along its ridges. CSV.", FILE)
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
    FILE,
)
@click.option("--accept", is_flag=True, help="Write the stripe even if it is undetermined.")
@click.option("--friction", is_flag=True, help="Fit friction and drift to all cycles and repeats.")
@options.output(
    "Material file to write, or to add the stripe to, .toml, with figures beside it.",
    default=Path("material.toml"),
)
def calibrate(
    record: Path,
    knit: Literal["rib", "garter"],
    stitches: int,
    period: float | None,
    gauge_length: float | None,
    gauge_stitches: float | None,
    cell_size: Literal["flat", "relaxed"] | None,
    law: Literal["linear", "stiffening", "tabulated"],
    spring_curve: Path | None,
    along: Path | None,
    along_width: float | None,
    along_gauge_length: float | None,
    accept: bool,
    friction: bool,
    output: Path,
    **swatch: Any,
) -> None:
    """Fit k_s, k_t and theta_0 of a stripe to the RECORD of a tensile test of its pure fabric.

    RECORD is a CSV file with a header such as "repeat [1],extension [mm],force [N]": strain, or
    extension with --gauge-length, and the force on a swatch of this --width, or the stress. Several
    repeats give one curve; of cycles, one loading branch is taken. Without --width, the force is
    that on one row of the network. Pull until the folds are open and the springs stretch, to about
    200 % strain: below that the three cannot be determined separately. --along adds the springs
    along the ridges; without it they are those of the other knit, and far too stiff. After the fit
    the swatch is simulated and compared with its record.
    """
    from knitlab.api.laboratory import calibrate_friction
    from knitlab.figures.fits import calibration_figure
    from knitlab.io.errors import invalid, naming
    from knitlab.lab import calibration
    from knitlab.lab.along_ridges import check_along
    from knitlab.lab.friction_fit import friction_report
    from knitlab.lab.swatch import report as swatch_report
    from knitlab.lab.swatch import simulated_swatches
    from knitlab.lab.swatch import warnings as swatch_warnings
    from knitlab.lab.tension_record import period_of, read_cycles, read_tension_record
    from knitlab.model.spring_law import SpringCurve
    from knitlab.runs.material import add_stripe, check_added
    from knitlab.runs.parameters import defaults
    from knitlab.runs.stripe_covariance import with_period

    check_suffix(output, TOML, "a material")
    if (law == "tabulated") != (spring_curve is not None):
        raise invalid("--spring-curve", "goes with --law tabulated; give both, or neither")
    other = {"width": along_width, "gauge_length": along_gauge_length}
    sizes = {name: size for name, size in other.items() if size is not None}
    for name, size in sizes.items() if along is None else ():
        option_name = f"--along-{name.replace('_', '-')} {size:g}"
        raise invalid(
            option_name, "is of the record along the ridges; give --along, or leave it out"
        )
    period = period_of(stitches, period, gauge_length, gauge_stitches)
    used_size = cell_size or defaults().model.cell_size
    swatch |= {"gauge_length": gauge_length}
    if friction:
        if law != "linear":
            raise invalid("--friction", "is fitted with linear springs; leave out --law")
        if along is not None:
            raise invalid("--friction", "is fitted across the ridges only; leave out --along")
        del swatch["cycle"]
        passages = read_cycles(record, **swatch)
        check_added(output, knit, stitches, used_size, passages.per_width)
        fit = calibrate_friction(passages, period=period)
        read = [f"record        {line}" for line in passages.summary]
        options.echo_report([*read, *friction_report(fit)])
        if fit.undetermined and not accept:
            unknown = f"the cycles do not determine {', '.join(fit.undetermined)}"
            hint = "measure to larger strain, or give --accept"
            options.echo_problem(f"no stripe is written, as {unknown}; {hint}")
            options.exit_unless(False)
        stripe = fit.stripe(knit, stitches, used_size)
        source = f"knitlab calibrate {record.name} --friction"
        add_stripe(output, stripe, source, cell_size=used_size)
        click.echo(f"stripe        {knit} {stitches} in {output}")
        click.echo(f"settings      {' '.join(f'--set {each}' for each in fit.settings)}")
        return
    measured = read_tension_record(record, **swatch)
    springs: Any = law
    if spring_curve is not None:
        table = read_tension_record(spring_curve, zero="none")
        with naming(str(spring_curve)):
            springs = SpringCurve(tuple(table.strain.tolist()), tuple(table.force[0].tolist()))
    curve, per_width = (period, measured.strain, measured.force), measured.per_width
    check_added(output, knit, stitches, used_size, per_width)
    ridges = None
    if along is not None:
        if not per_width:
            message = "is missing, without which forces along and across cannot be compared"
            hint = f"give the width of the swatch of {record.name} in mm"
            raise invalid("--width", f"{message}; {hint}, and --along-width if the other differs")
        # A preload is that of the other record.
        pulled = read_tension_record(along, **(swatch | sizes | {"preload": None}))
        if pulled.per_width != per_width:
            kinds = {True: "force over width", False: "force on one row"}
            message = f"has a {kinds[pulled.per_width]}, and {record.name} a {kinds[per_width]}"
            raise invalid(str(along), f"{message}; give the widths of both, or none")
        ridges = pulled.strain, pulled.force.mean(axis=0)
        with naming(str(along)):
            check_along(*ridges)
    with naming(str(record)):
        fitted = calibration.calibrate(*curve, springs, per_width=per_width, along=ridges)
        linear = None if law == "linear" else calibration.calibrate(*curve, per_width=per_width)
    title = f"{stitches} × {stitches} {knit}, period {period:g} mm"
    compared = calibration.report_comparison(fitted, linear) if linear else []
    read = [f"record   {line}" for line in measured.summary]
    options.echo_report([title, *read, *calibration.report(fitted), *compared], fitted.warnings)
    swatches = simulated_swatches(fitted) if fitted.converged else []
    options.echo_report(swatch_report(swatches), swatch_warnings(swatches))
    accepted = fitted.usable or (accept and fitted.converged)
    if accepted:
        source = calibration.source_of(fitted, record, used_size)
        stripe = fitted.stripe(knit, stitches, used_size)
        covariance = fitted.covariance
        if used_size == "flat":
            covariance = with_period(covariance, fitted.values["theta_0"])
        add_stripe(output, stripe, source, covariance, used_size)
        click.echo(f"stripe   {knit} {stitches} in {output}")
    elif fitted.converged:
        unknown = f"the record does not determine {', '.join(fitted.undetermined)}"
        measure = f"measure to a strain of {fitted.wanted_strain:.2g}, where the folds are open"
        options.echo_problem(f"no stripe is written, as {unknown}; {measure}, or give --accept")
    else:
        options.echo_problem("no stripe is written, as this fit did not converge; measure again")
    beside = output.with_name(f"{output.stem}-{knit}-{stitches}.toml")
    options.draw_beside(beside, lambda: calibration_figure(fitted, title, linear, swatches))
    options.exit_unless(accepted)


@click.command(name="import")
@click.argument("kind", type=click.Choice(["markers", "tensile", "capacitance"]))
@click.argument("description", type=FILE)
@options.results
def import_records(kind: "RecordKind", description: Path, results: Path) -> None:
    """Import laboratory records as a cube, to compare with simulations.

    They are described by DESCRIPTION, a TOML file: tracked markers, a tensile test, or the log of
    an LCR meter, by their KIND.
    """
    from knitlab.lab import experiment

    imported = experiment.import_records(kind, description, results)
    options.echo_report(imported.summary)
    click.echo(f"cube    {imported.path}")


@click.command()
@click.argument("experiment", type=PATH)
@click.argument("workflow")
@options.settings
@options.select
@option(
    "--looseness",
    "Relative standard deviation of the tabulated stripes.",
    click.FloatRange(0, 2, min_open=True),
    default=0.2,
)
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
@options.output("Stripes to write, .toml, with figures beside it.", default=Path("fitted.toml"))
def fit(
    experiment: Path,
    workflow: str,
    settings: tuple[str, ...],
    selections: dict[str, Any],
    output: Path,
    **numbers: Any,
) -> None:
    """Fit k_s, k_t and theta_0 of both stripes to an imported EXPERIMENT on a whole fabric.

    The sample is the only case of WORKFLOW with the design of the experiment. It is simulated
    about ten to fifty times; if interrupted, the same command continues.
    """
    from knitlab.api import laboratory as api
    from knitlab.cubes.cube_file import cube_name, open_cube
    from knitlab.cubes.selection import select
    from knitlab.figures.fits import fit_figure
    from knitlab.lab.fit import fitted_material, report
    from knitlab.runs.plan import make_plan

    check_suffix(output, TOML, "a material")
    cube = select(open_cube(experiment), selections)
    began = time.monotonic()

    def report_step(tests: int, chi_squared: float) -> None:
        if tests == 1:
            seconds = time.monotonic() - began
            click.echo(f"the first test took {seconds:.0f} s; usual are 10 to 50 tests", err=True)
        click.echo(f"test {tests}: chi² {chi_squared:.4g}", err=True)

    kept = output.with_suffix(".tests")
    plan = make_plan(workflow, settings)
    fitted = api.fit(cube, plan, step=report_step, kept=kept, **numbers)
    options.echo_report(report(fitted), fitted.warnings)
    fitted_material(fitted, experiment).write(output)
    shutil.rmtree(kept, ignore_errors=True)
    click.echo(f"stripes  {output}")
    title = f"{fitted.before.label}, fitted to {cube_name(cube)}"
    options.draw_beside(output, lambda: fit_figure(fitted, title))
    options.exit_unless(fitted.converged)


COMMANDS = (calibrate, import_records, fit)
