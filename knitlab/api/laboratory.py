"""Measurements: stripes from tension curves, and from tests of whole fabrics."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.api.cubes import Cube, as_cube
from knitlab.api.renamed import renamed
from knitlab.cubes.cube_file import cube_name
from knitlab.cubes.selection import select
from knitlab.figures.figure_files import draw_into
from knitlab.io.errors import invalid, naming
from knitlab.io.names import check_suffix
from knitlab.io.table_readings import Decimal
from knitlab.io.toml import TOML
from knitlab.lab.calibration import Calibration, Law
from knitlab.lab.calibration import calibrate as fit_sheet
from knitlab.lab.curves import case_for, measured_test
from knitlab.lab.experiment import import_records as import_records
from knitlab.lab.fit import Fit, Step, fit_stripes
from knitlab.lab.friction_fit import FrictionFit, fit_friction
from knitlab.lab.record_start import Zero
from knitlab.lab.swatch import Swatch, simulated_swatches
from knitlab.lab.tension_record import (
    LoadingCycles,
    TensionRecord,
    read_cycles,
    read_tension_record,
    relaxed_period,
)
from knitlab.model.computing import computing
from knitlab.model.settings import CellSize
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe import Knit, Stripe
from knitlab.runs.material import add_stripe, check_added
from knitlab.runs.parameters import defaults
from knitlab.runs.plan import Plan, make_plan
from knitlab.runs.stripe_covariance import with_period

Curve = Sequence[float] | Float[np.ndarray, " point"]
AlongStrain = Sequence[float] | Float[np.ndarray, " along"]
AlongForce = AlongStrain | Float[np.ndarray, "repeat_along along"]


@computing()
def calibrate(
    strain: Curve,
    force: Curve | Float[np.ndarray, "repeat point"],
    *,
    period: float,
    law: Law = "linear",
    per_width: bool = False,
    along: tuple[AlongStrain, AlongForce] | None = None,
) -> Calibration:
    """Fit k_s, k_t and θ0 of a stripe to the tension curve of its pure fabric.

    The fit is that of the endless sheet of the paper's 3D model, so that the simulated swatch comes
    back (:func:`knitlab.simulated_swatches`). Measure until the folds are open and the springs
    stretch, to about 200 % strain: below that the three cannot be determined separately, and
    ``undetermined`` names those that are not. :func:`knitlab.calibrate_stripe` does all of this
    from a file.

    Args:
        strain: strain relative to the relaxed period, not negative [1].
        force: force on one row of the network [N], also of several repeats, as
            :func:`knitlab.read_tension_record` gives it.
        period: relaxed peak-to-peak distance of the stripe [mm].
        law: of the springs: ``"linear"``, ``"stiffening"``, whose stiffening strain is fitted too,
            or a :class:`~knitlab.model.spring_law.SpringCurve`.
        per_width: whether the force is over the width of the swatch [N/mm].
        along: strain and force along the ridges, in the same unit, or on one column of the network.
            Without it springs along the ridges are those of the other stripe of a fabric, as in the
            paper, and far too stiff.

    Returns:
        The fitted parameters with standard errors, 95 % intervals and correlations; its method
        ``compared_with`` compares this law with a simpler one by AICc.

    Raises:
        InputError: if the curve has too few points, or no tension.

    Example:
        >>> record = kl.read_tension_record("docs/examples/swatches/records/rib.csv", width=95.5)
        >>> fitted = kl.calibrate(record.strain, record.force, period=10, per_width=True)
        >>> round(fitted.values["theta_0"], 2)
        0.74
    """

    def record(curve: tuple[Any, Any], source: str) -> TensionRecord:
        at, pulled = (np.asarray(each, float) for each in curve)
        return TensionRecord(at, np.atleast_2d(pulled), per_width, source=source)

    ridges = None if along is None else record(along, "along")
    return fit_sheet(float(period), record((strain, force), "curve"), law, ridges)


@computing()
def calibrate_friction(cycles: LoadingCycles, *, period: float) -> FrictionFit:
    """Fit k_s, k_t, θ0, friction and drift of a stripe to loading cycles of its pure fabric.

    All passages are fitted together, in their order, beginning with the first loading. Loading
    alone, repeated, determines the drift; the friction needs unloading.

    Args:
        cycles: loading and unloading, as :func:`knitlab.read_cycles` gives them.
        period: relaxed peak-to-peak distance of the stripe [mm].

    Returns:
        The parameters with standard errors; ``fit.stripe("rib", 4)`` and ``fit.friction`` for
        :func:`knitlab.simulate`, and ``fit.comparison`` with a stripe without friction by AICc.

    Raises:
        InputError: if there is one passage alone, too few points, or no tension.

    Example:
        >>> records = "docs/examples/swatches/records/rib.csv"
        >>> fit = kl.calibrate_friction(kl.read_cycles(records, width=100), period=10)
        >>> f"{fit.values['fold_drift']:.2f} ± {fit.standard_errors['fold_drift']:.2f}"
        '0.03 ± 0.01'
    """
    with naming("cycles"):
        return fit_friction(float(period), cycles)


@dataclass(frozen=True)
class StripeCalibration:
    """A stripe calibrated on the record of its swatch.

    Attributes:
        stripe: the stripe.
        fit: its fit.
        report: what was read and fitted, in lines of text.
        warnings: reasons to doubt the fit.
        refusal: why the stripe is not written and what to do; empty if it can be used.
        settings: friction and drift as settings of a workflow, if they were fitted.
        swatches: simulations of the swatch, with their records.
        figure: the file of the figure, if one was drawn.
    """

    stripe: Stripe
    fit: Calibration | FrictionFit
    report: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    refusal: str = ""
    settings: tuple[str, ...] = ()
    swatches: tuple[Swatch, ...] = ()
    figure: Path | None = None

    def __repr__(self) -> str:
        return f"<StripeCalibration {self.stripe.knit} {self.stripe.n}: {self.fit!r}>"


@computing()
def calibrate_stripe(
    record: str | Path,
    knit: Knit,
    n: int,
    *,
    period: float | None = None,
    gauge_length: float | None = None,
    gauge_stitches: float | None = None,
    width: float | None = None,
    thickness: float | None = None,
    zero: Zero | None = None,
    preload: float | None = None,
    cycle: int = 1,
    decimal: Decimal | None = None,
    table: int | None = None,
    along: str | Path | None = None,
    along_width: float | None = None,
    along_gauge_length: float | None = None,
    law: Literal["linear", "stiffening", "tabulated"] = "linear",
    spring_curve: str | Path | None = None,
    friction: bool = False,
    cell_size: CellSize | None = None,
    accept: bool = False,
    output: str | Path | None = None,
) -> StripeCalibration:
    """Calibrate a stripe on the record of a tensile test of its pure fabric.

    The record is read (:func:`knitlab.read_tension_record`) and fitted (:func:`calibrate`), the
    swatch is simulated and compared with its record, and the stripe is added to a material file.

    Args:
        record: file of the test, pulled across the ridges.
        knit: ``"rib"`` or ``"garter"``.
        n: stitches across the stripe.
        period: relaxed peak-to-peak distance [mm].
        gauge_length: relaxed length between the clamps [mm].
        gauge_stitches: stitches along the gauge length, in place of the period.
        width: width of the swatch that the force pulls [mm].
        thickness: thickness of the fabric, for stress over area [mm].
        zero: what is subtracted from the force: ``"none"``, ``"start"`` or a number [N].
        preload: tension at which the record began [N].
        cycle: the cycle whose loading is taken.
        decimal: the decimal mark of the files, ``"."`` or ``","``, if their numbers do not show it.
        table: which table is read, from 1, of files with several.
        along: file of the same fabric pulled along its ridges.
        along_width: width of that swatch, by default ``width`` [mm].
        along_gauge_length: its gauge length, by default ``gauge_length`` [mm].
        law: of the springs: ``"linear"``, ``"stiffening"`` or ``"tabulated"``; other laws are
            compared with linear springs.
        spring_curve: file of the measured curve of a spring, for ``"tabulated"``.
        friction: whether to fit friction and drift to all cycles and repeats instead.
        cell_size: model option to simulate the stripe with, by default that of the parameters.
        accept: whether to accept a stripe that the record does not determine.
        output: material file to which the stripe is added, with a figure beside it.

    Returns:
        The stripe, its fit, and a report.

    Raises:
        InputError: with every mistake of a file, or if the arguments contradict each other or the
            stripes in the file.

    Example:
        >>> record = "docs/examples/swatches/rib.csv"
        >>> result = kl.calibrate_stripe(record, "rib", 4, period=10)
        >>> result.fit.usable, round(result.stripe.theta_0, 2)
        (True, 0.74)
    """
    if output is not None:
        check_suffix(Path(output), TOML, "a material")
    if spring_curve is not None and law != "tabulated":
        raise invalid("spring_curve", "is used with law = tabulated; give both, or neither")
    along_sizes = {"width": along_width, "gauge_length": along_gauge_length}
    along_sizes = {name: size for name, size in along_sizes.items() if size is not None}
    for name, length in along_sizes.items() if along is None else ():
        message = "needs the record along the ridges; give along = FILE, or leave it out"
        raise invalid(f"along_{name} {length:g}", message)
    period = relaxed_period(n, period, gauge_length, gauge_stitches)
    size = cell_size or defaults().model.cell_size
    swatch: dict[str, Any] = {"gauge_length": gauge_length, "width": width, "zero": zero}
    swatch |= {"thickness": thickness, "preload": preload, "decimal": decimal, "table": table}
    name, material = Path(record).name, None if output is None else Path(output)
    if friction:
        if law != "linear" or along is not None:
            message = "is fitted with linear springs, across the ridges only"
            raise invalid("friction", f"{message}; leave out law and along")
        cycles = read_cycles(record, **swatch)
        if material is not None:
            check_added(material, knit, n, size, cycles.per_width)
        fitted = calibrate_friction(cycles, period=period)
        stripe, refusal = fitted.stripe(knit, n, size), ""
        if fitted.undetermined and not accept:
            refusal = f"the cycles do not determine {', '.join(fitted.undetermined)}; measure to"
            refusal += " larger strain, or give accept = True"
        elif material is not None:
            source = f"knitlab calibrate {name}, with friction and drift"
            add_stripe(material, stripe, source, cell_size=size)
        report = [*(f"record        {line}" for line in cycles.summary), *fitted.report]
        settings = tuple(fitted.settings)
        return StripeCalibration(stripe, fitted, tuple(report), refusal=refusal, settings=settings)
    across = read_tension_record(record, cycle=cycle, **swatch)
    if material is not None:
        check_added(material, knit, n, size, across.per_width)
    ridges = None
    if along is not None:
        if not across.per_width:
            message = "is missing, without which forces along and across cannot be compared"
            hint = f"give that of {name} in mm, and if the other differs give along_width = WIDTH"
            raise invalid("width", f"{message}; {hint}")
        # A preload is that of the other record.
        other = swatch | along_sizes | {"preload": None}
        ridges = read_tension_record(along, cycle=cycle, **other)
    springs = _measured_law(spring_curve, decimal) if law == "tabulated" else law
    fit = fit_sheet(period, across, springs, ridges)
    linear = None if law == "linear" else fit_sheet(period, across)
    swatches = simulated_swatches(fit) if fit.converged else []
    title = f"{n} × {n} {knit}, period {period:g} mm"
    report = [title, *(f"record   {line}" for line in across.summary), *fit.report]
    report += [] if linear is None else fit.comparison_report(linear)
    report += [each.report for each in swatches]
    refusal = ""
    if not fit.converged:
        refusal = "this fit did not converge; measure again"
    elif fit.undetermined and not accept:
        refusal = f"the record does not determine {', '.join(fit.undetermined)}; measure to a"
        refusal += f" strain of {fit.wanted_strain:.2g}, where the folds are open, or give"
        refusal += " accept = True"
    stripe, figure = fit.stripe(knit, n, size), None
    if material is not None:
        if not refusal:
            covariance = fit.covariance
            if size == "flat":
                covariance = with_period(covariance, fit.values["theta_0"])
            add_stripe(material, stripe, fit.source(name, size), covariance, size)
        from knitlab.figures.fits import calibration_figure

        figure = material.with_name(f"{material.stem}-{knit}-{n}.png")
        draw_into(lambda: calibration_figure(fit, title, linear, swatches), figure)
    return StripeCalibration(
        stripe,
        fit,
        tuple(report),
        warnings=(*fit.warnings, *(each.warning for each in swatches if each.warning)),
        refusal=refusal,
        swatches=tuple(swatches),
        figure=figure,
    )


def _measured_law(path: str | Path | None, decimal: Decimal | None) -> SpringCurve:
    """The law of springs whose curve is in a file."""
    if path is None:
        raise invalid("spring_curve", "is missing; give it for law = tabulated")
    curve = read_tension_record(path, zero="none", decimal=decimal)
    with naming(str(path)):
        return SpringCurve(tuple(curve.strain.tolist()), tuple(curve.mean_force.tolist()))


@renamed(looseness="prior_std")
@computing()
def fit(
    experiment: Cube,
    workflow: str | Path | Plan,
    overrides: Sequence[str] = (),
    *,
    selections: Mapping[str, Any] = {},
    prior_std: float = 0.2,
    model_error: float = 0.01,
    starts: int = 4,
    step: Step = lambda tests, chi_squared: None,
    kept: str | Path | None = None,
    output: str | Path | None = None,
    **settings: Any,
) -> Fit:
    """Fit k_s, k_t and θ0 of both stripes to a test of a whole fabric.

    The sample is simulated about ten to fifty times.

    Args:
        experiment: cube of one experiment on one design, in one cycle.
        workflow: name, path or plan of a workflow with only one case of that design.
        overrides: settings to replace as text, ``"k_wall=50"``, in place of ``settings``.
        selections: values of coordinates of the experiment, such as ``{"cycle": 1}``.
        prior_std: relative standard deviation of the tabulated stripes, as a prior.
        model_error: error of the model, as a fraction of the largest value of a curve.
        starts: largest number of starts that are tried until the test is matched.
        step: called after every test with the number of tests and χ² of the last.
        kept: folder that keeps the tests, so that an interrupted fit continues where it was; by
            default beside ``output``, until that is written.
        output: material file to write, with a figure beside it.
        settings: settings of the workflow to replace.

    Returns:
        The fitted stripes with their standard errors, curves and warnings.

    Raises:
        InputError: if the experiment cannot be fitted, the workflow has no or several such cases,
            its test does not converge, or settings are given beside a plan.
    """
    if isinstance(workflow, Plan) and (settings or overrides):
        raise invalid("settings", "belong to workflows; plan the workflow with them")
    material = None if output is None else Path(output)
    if material is not None:
        check_suffix(material, TOML, "a material")
    plan = workflow
    if not isinstance(plan, Plan):
        plan = make_plan(str(workflow), overrides or settings)
    cube = select(as_cube(experiment), selections)
    case = case_for(plan, cube)
    target = measured_test(cube, case, model_error)
    case = replace(case, applied_strain=(0.0, *target.applied_strain))
    folder = None if kept is None else Path(kept)
    if material is not None and kept is None:
        folder = material.with_suffix(".tests")
    fitted = fit_stripes(case, target, prior_std, starts=starts, step=step, kept=folder)
    if material is not None:
        from knitlab.figures.fits import fit_figure

        name = cube_name(cube)
        source = Path(name) if isinstance(experiment, xr.Dataset) else Path(experiment)
        fitted.material(source).write(material)
        if kept is None:
            shutil.rmtree(material.with_suffix(".tests"), ignore_errors=True)
        title = f"{fitted.before.label}, fitted to {name}"
        draw_into(lambda: fit_figure(fitted, title), material.with_suffix(".png"))
    return fitted
