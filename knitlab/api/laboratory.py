"""Measurements: stripes from tension curves, and from tests of whole fabrics."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.api.cubes import Cube, as_cube
from knitlab.io.errors import invalid, naming
from knitlab.lab.along_ridges import check_along
from knitlab.lab.calibration import Calibration, Law
from knitlab.lab.calibration import calibrate as fit_sheet
from knitlab.lab.curves import case_for, target_of
from knitlab.lab.fit import Fit, Step, fit_stripes
from knitlab.lab.friction_fit import FrictionFit, LoadingCycles, fit_friction
from knitlab.runs.plan import Plan, make_plan

Curve = Sequence[float] | Float[np.ndarray, " point"]
AlongStrain = Sequence[float] | Float[np.ndarray, " along"]
AlongForce = AlongStrain | Float[np.ndarray, "repeat_along along"]


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
    ``undetermined`` names those that are not.

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
        The fitted numbers with standard errors, 95 % intervals and correlations; its method
        ``compared_with`` compares this law with a simpler one by AICc.

    Raises:
        InputError: if the curve has too few points, or no tension.

    Example:
        >>> import numpy as np
        >>> from knitlab.model.pure_stripe import PureStripe, tension_across
        >>> stripe = kl.Stripe("rib", 4, period=1.41, k_s=0.817, theta_0=0.772, k_t=0.0107)
        >>> strain = np.linspace(0.05, 2.5, 40)
        >>> force = tension_across(PureStripe.of(stripe), strain)
        >>> fitted = kl.calibrate(strain, force, period=1.41)
        >>> round(fitted.values["k_s"], 3)
        0.817
    """
    ridges = None
    if along is not None:
        ridges = np.asarray(along[0], float), np.atleast_2d(np.asarray(along[1], float)).mean(0)
        with naming("along"):
            check_along(*ridges)
    with naming("curve"):
        curve = np.asarray(strain, float), np.asarray(force, float)
        return fit_sheet(float(period), *curve, law, per_width=per_width, along=ridges)


def calibrate_friction(cycles: LoadingCycles, *, period: float) -> FrictionFit:
    """Fit k_s, k_t, θ0, friction and drift of a stripe to loading cycles of its pure fabric.

    All passages are fitted together, in their order, beginning with the first loading. Loading
    alone, repeated, determines the drift; the friction needs unloading.

    Args:
        cycles: loading and unloading, as :func:`knitlab.read_cycles` gives them.
        period: relaxed peak-to-peak distance of the stripe [mm].

    Returns:
        The numbers with standard errors; ``fit.stripe("rib", 4)`` and ``fit.friction`` for
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


def fit(
    experiment: Cube,
    workflow: str | Path | Plan,
    *,
    looseness: float = 0.2,
    model_error: float = 0.01,
    starts: int = 4,
    step: Step = lambda tests, chi_squared: None,
    kept: str | Path | None = None,
    **settings: Any,
) -> Fit:
    """Fit k_s, k_t and θ0 of both stripes to a test of a whole fabric.

    The sample is simulated about ten to fifty times.

    Args:
        experiment: cube of one experiment on one design, in one cycle.
        workflow: name, path or plan of a workflow with only one case of that design.
        looseness: relative standard deviation of the tabulated stripes, as a prior.
        model_error: error of the model, as a fraction of the largest value of a curve.
        starts: largest number of starts that are tried until the test is matched.
        step: called after every test with the number of tests and χ² of the last.
        kept: folder that keeps the tests, so that an interrupted fit continues where it was.
        settings: settings of the workflow to replace.

    Returns:
        The fitted stripes with their standard errors, curves and warnings.

    Raises:
        InputError: if the experiment cannot be fitted, the workflow has no or several such cases,
            its test does not converge, or settings are given beside a plan.
    """
    if isinstance(workflow, Plan) and settings:
        raise invalid("settings", "belong to workflows; plan the workflow with them")
    plan = workflow if isinstance(workflow, Plan) else make_plan(str(workflow), settings)
    cube = as_cube(experiment)
    case = case_for(plan, cube)
    target = target_of(cube, case, model_error)
    case = replace(case, applied_strain=(0.0, *target.applied_strain))
    folder = None if kept is None else Path(kept)
    return fit_stripes(case, target, looseness, starts=starts, step=step, kept=folder)
