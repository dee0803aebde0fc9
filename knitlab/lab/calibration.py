"""Calibration: the stripe whose endless sheet has a measured tension curve.

The paper fits the zigzag of its 2D model, which is a sheet without diagonals. A sheet with the
parameters of a zigzag is stiffer once it is unfolded, and would not reproduce a measured swatch.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import OptimizeResult, least_squares

from knitlab.io.errors import invalid, naming
from knitlab.lab.along_ridges import AlongRidges, check_along, springs_along
from knitlab.lab.fit_statistics import (
    Comparison,
    FitErrors,
    compare,
    covariance_of_unit_noise,
    errors_by_residuals,
    errors_by_scatter,
)
from knitlab.lab.tension_record import TensionRecord
from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.pure_stripe import PureStripe, tension_across
from knitlab.model.settings import CellSize
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.spring_law import CurveLaw
from knitlab.model.stripe import Knit, Stripe
from knitlab.model.stripe_covariance import MIN_REPEATS, StripeCovariance
from knitlab.model.zigzag import stripe_law

Law = Literal["linear", "stiffening"] | SpringCurve
"""Kind of spring law; the shape of a tabulated curve is not fitted."""

FITTED = ("k_s", "k_t", "theta_0")
FITTED_IF_STIFFENING = (*FITTED, "stiffening_strain")
"""Fitted parameters, in this order."""
AS_LOGARITHM = np.array([True, True, False, True])
"""Which of them are fitted as logarithms: all except the angle."""
UNITS = {"k_s": "N/mm", "k_t": "N", "theta_0": "rad", "stiffening_strain": "1"}
"""Units as in the paper's tables, except for k_t, which is N mm for an edge."""
ENTRY_UNITS = {"period": "mm", **UNITS}
BOUNDS = {
    "k_s": (1e-4, 1e4),
    "k_t": (1e-7, 1e2),
    "theta_0": (0.05, np.pi - 0.05),
    "stiffening_strain": (1e-3, 1e2),
}
"""Range in which each parameter is searched [N/mm, N mm, rad, 1]."""
STARTING_ANGLES = (0.4, 0.8, 1.4)
STARTING_FACTORS = (0.3, 3.0)
STARTING_STRAINS = (0.1, 1.0)
ALIKE_CORRELATION = 0.99
VAGUE_ERROR = 0.1
USELESS_ERROR = 0.5
"""Standard error of a logarithm, or of the angle [rad], above which it is undetermined."""
MODEL_ERROR, INDEPENDENT = 0.01, 10
"""Error of any model, over the largest force, and the count of independent errors in a curve.
Even without noise, a curve that ends before the springs stretch does not determine them."""
OF_SPRINGS = ("k_s", "stiffening_strain")
BEYOND_OPEN = 1.1  # of the length of open folds, that a curve should reach
CORRELATED = 0.5  # correlation of neighbouring residuals from which on there is a warning
ROUND_OFF = 1e-6  # misfit over the largest force below which residuals are round-off
AT_BOUND = 1e-3
"""Distance from a bound, in the fitted unknown, up to which a value counts as on the bound."""
ALTERNATIONS = 6  # at most, of fits across the ridges and along them
SETTLED = 0.01  # relative change of k_s, k_t and θ0 that ends them

Points = Float[np.ndarray, " point"]
Unknowns = Float[np.ndarray, " fitted"]


@dataclass(frozen=True, kw_only=True)
class SheetFit:
    """Fitted k_s [N/mm], k_t [N mm], theta_0 [rad] and stiffening strain [1] of an endless sheet.

    Forces are on one row [N] or, if ``per_width``, over the width [N/mm].
    """

    period: float  # relaxed peak-to-peak distance of the stripe, as given [mm]
    values: dict[str, float]
    standard_errors: dict[str, float]
    per_width: bool
    law: Law = "linear"
    along: AlongRidges | None = None  # springs along the ridges, if a curve along them was given

    @property
    def flat_cell(self) -> float:
        """Side of a flat cell of the sheet [mm]."""
        return self.period / (CELLS_PER_PERIOD * math.sin(self.values["theta_0"] / 2))

    @property
    def force_unit(self) -> str:
        """Unit of its forces."""
        return "N/mm" if self.per_width else "N"

    def stripe(self, knit: Knit, n: int, cell_size: CellSize = "flat") -> Stripe:
        """The fitted stripe, for a design with this model option.

        Its period is that of the relaxed or of the flat stripe, which is longer by 1/sin(θ0/2).
        """
        flat, along = CELLS_PER_PERIOD * self.flat_cell, self.along
        return Stripe(
            knit,
            n,
            flat if cell_size == "flat" else self.period,
            **dict[str, Any]({name: self.values[name] for name in self.values if name in UNITS}),
            spring_curve=self.law if isinstance(self.law, SpringCurve) else None,
            # A row of the pure sheet is as wide as its cells are long.
            row_width=self.flat_cell if self.per_width else None,
            stretch_along=None if along is None else along.stretch,
            curve_along=None if along is None else along.curve,
        )


@dataclass(frozen=True, kw_only=True)
class Calibration(SheetFit):
    """A fitted stripe, and how well the curve determines it."""

    intervals: dict[str, tuple[float, float]]  # of 95 % confidence
    correlations: Float[np.ndarray, "fitted fitted"]  # in the order of ``values``
    strain: Points
    force: Points  # of the curve, the mean of all repeats
    fitted_force: Points
    starts: tuple[int, int]  # number of starts, and of those that ended at this fit
    converged: bool  # whether the optimiser met its tolerances
    iterations: int  # number of Jacobians from the best start
    undetermined: tuple[str, ...]  # parameters that the curve does not determine
    warnings: tuple[str, ...]
    repeats: int  # from 2 on, errors are those of the mean of their own fits
    degrees_of_freedom: float  # of the errors
    autocorrelation: float  # of neighbouring residuals, if errors come from these

    def __repr__(self) -> str:
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.values.items())
        return f"<Calibration {values}: {len(self.strain)} points, {len(self.warnings)} warnings>"

    @property
    def usable(self) -> bool:
        """Whether the fit converged, and the curve determines every parameter."""
        return self.converged and not self.undetermined

    @property
    def wanted_strain(self) -> float:
        """Strain that a curve should reach: a tenth beyond the length of open folds."""
        return BEYOND_OPEN / math.sin(self.values["theta_0"] / 2) - 1

    @property
    def misfit(self) -> float:
        """Root mean square difference between curve and fit."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def covariance(self) -> StripeCovariance:
        """Covariance of ln k_s, ln k_t, θ0 and the logarithm of a stiffening strain, by name.

        It is that of the mean stripe, with rows as wide as its own if forces are over width.
        """
        scales = self.values | {"theta_0": 1.0}
        errors = np.array([self.standard_errors[name] / scales[name] for name in self.values])
        rows = self.correlations * np.outer(errors, errors)
        if self.per_width:
            slopes = np.eye(len(rows))
            # A flat cell is the relaxed one over sin(θ0/2).
            slopes[:2, 2] = 0.5 / math.tan(self.values["theta_0"] / 2)
            rows = slopes @ rows @ slopes.T
        table = {
            name: dict(zip(self.values, row, strict=True))
            for name, row in zip(self.values, rows.tolist(), strict=True)
        }
        repeats = self.repeats if self.repeats >= MIN_REPEATS else None
        return StripeCovariance(table, self.degrees_of_freedom, repeats)

    @property
    def residuals(self) -> Points:
        """Curve minus fit."""
        return self.force - self.fitted_force

    def compared_with(self, simpler: "Calibration") -> Comparison:
        """Comparison of this law with a simpler one that was fitted to the same curve."""
        order = np.argsort(self.strain, kind="stable")
        residuals = simpler.residuals[order], self.residuals[order]
        return compare(*residuals, (len(simpler.values), len(self.values)))

    @property
    def report(self) -> list[str]:
        """The fit in lines of text: parameters with errors, correlations, misfit."""
        tried, agreeing = self.starts
        freedom = f"Student's t with {self.degrees_of_freedom:.3g} degrees of freedom"
        errors = f"of the mean of {self.repeats} repeats, by their scatter, as of {self.repeats}"
        errors += f" swatches; {freedom}"
        if self.repeats < MIN_REPEATS:
            errors = "of the points of one curve, neighbours correlated by"
            errors += f" {self.autocorrelation:.2f}; {freedom}; nothing is known about the scatter"
            errors += " of new swatches"
        lines = [
            f"{name:8s} {self.values[name]:.5g} ± {self.standard_errors[name]:.2g}"
            f" {UNITS[name]}, 95 %: {low:.5g} to {high:.5g}"
            for name, (low, high) in self.intervals.items()
        ]
        for (row, one), (column, other) in itertools.combinations(enumerate(self.values), 2):
            lines.append(f"correlation of {one} and {other}: {self.correlations[row, column]:+.4f}")
        lines += [
            f"errors   {errors}",
            f"misfit   {self.misfit:.2g} {self.force_unit} rms over {len(self.strain)} points;"
            f" {agreeing} of {tried} starts agree, {self.iterations} steps",
        ]
        if self.along is not None:
            lines.append(
                f"along    {self.along.stretch:.4g} N/mm over flat width and strain at rest; a"
                f" curve of {len(self.along.curve.strain)} points; misfit {self.along.misfit:.2g}"
                f" {self.force_unit} rms over {len(self.along.strain)} points"
            )
        return lines

    def source(self, record: str, cell_size: CellSize) -> str:
        """The source of the stripe that was fitted to the record of this name, for its table."""
        errors = [f"{name} {each:.2g} {UNITS[name]}" for name, each in self.standard_errors.items()]
        fit = f"knitlab calibrate {record}, relaxed period {self.period:g} mm"
        parts = [f"{fit}, for cell_size {cell_size}", f"standard errors {', '.join(errors)}"]
        return "; ".join([*parts, *self.warnings])

    def comparison_report(self, linear: "Calibration") -> list[str]:
        """Which of this law and linear springs the curve supports, in lines of text."""
        comparison = self.compared_with(linear)
        name = "tabulated" if isinstance(self.law, SpringCurve) else self.law
        if math.isnan(comparison.gain_if_correlated):
            verdict = "too few points to decide between the laws"
        elif comparison.wanted:
            verdict = f"the curve supports {name} springs"
        elif comparison.refused:
            verdict = "the curve supports linear springs"
        else:
            verdict = "the curve does not decide; linear springs are sufficient"
        if not self.usable:
            verdict += f"; the {name} fit cannot be used"
        before, after = comparison.autocorrelation
        return [
            f"linear   misfit {linear.misfit:.2g} {linear.force_unit} rms, against"
            f" {self.misfit:.2g} {self.force_unit} {name}",
            f"AICc     {name} springs gain {comparison.gain:+.1f} if residuals are independent,"
            f" {comparison.gain_if_correlated:+.1f} if neighbours are correlated (by {before:.2f}"
            f" linear, {after:.2f} {name})",
            f"law      {verdict}",
        ]


def calibrate(
    period: float, record: TensionRecord, law: Law = "linear", along: TensionRecord | None = None
) -> Calibration:
    """Fit a stripe to tension curves across its ridges and, if there is one, along them, in turn.

    Without a record along them, springs along the ridges are those across, as in the paper.
    """
    if not isinstance(law, SpringCurve) and law not in ("linear", "stiffening"):
        raise invalid("law", f"is {law!r}; give linear, stiffening or the curve of a spring")
    if along is not None:
        if along.per_width != record.per_width:
            message = (
                f"and {record.source} are not both over width; give the widths of both, or none"
            )
            raise invalid(along.source, message)
        with naming(along.source):
            check_along(along.strain, along.mean_force)
    strain, force = record.strain, record.mean_force
    number = len(FITTED_IF_STIFFENING if law == "stiffening" else FITTED)
    with naming(record.source):
        if len(strain) <= number:
            raise ValueError(f"has {len(strain)} points; give at least {number + 1}")
        if not np.any(force):
            raise ValueError("has a force of zero throughout; give a curve under tension")
        if not np.sum(strain * force) > 0:
            raise ValueError("has a force that falls with strain; give tension as positive")
    first = fitted = _fit_across(period, record, law)
    if along is None:
        return fitted
    for _ in range(ALTERNATIONS):
        last = fitted.values
        springs = springs_along(PureStripe.of(fitted.stripe("rib", 1, "relaxed")), along)
        fitted = _fit_across(period, record, law, springs, last)
        fitted = replace(fitted, along=springs, starts=first.starts)
        if all(abs(value / last[name] - 1) < SETTLED for name, value in fitted.values.items()):
            return fitted
    unsettled = "fits across the ridges and along them do not settle; do not use this one"
    return replace(fitted, converged=False, warnings=(*fitted.warnings, unsettled))


def _fit_across(
    period: float,
    record: TensionRecord,
    law: Law,
    along: AlongRidges | None = None,
    begin: Mapping[str, float] | None = None,
) -> Calibration:
    """Fit a sheet to its tension curve by bounded least squares, from several starts.

    Of repeats, parameters are means (of logarithms, and of the angle), and errors follow from the
    scatter. Errors of one curve follow from its residuals and their correlation.
    """
    strain, mean, per_width = record.strain, record.mean_force, record.per_width
    fitted = FITTED_IF_STIFFENING if law == "stiffening" else FITTED
    as_logarithm = AS_LOGARITHM[: len(fitted)]
    curve = law if isinstance(law, SpringCurve) else None
    bounds = _unknowns(np.array([BOUNDS[name] for name in fitted]).T)

    springs = None if along is None else (along.stretch, CurveLaw.of(along.curve))
    laws, given = (curve, per_width), (period, strain, springs)

    def forces(unknowns: Unknowns) -> Points:
        return np.asarray(_force(*laws, unknowns, *given))

    def fit_to(measured: Points, start: Unknowns) -> OptimizeResult:
        scale = float(np.max(np.abs(measured)))
        return least_squares(
            lambda x: (forces(x) - measured) / scale,
            np.clip(start, *bounds),
            jac=lambda x: np.asarray(_force_slopes(*laws, x, *given)) / scale,
            bounds=bounds,
            x_scale="jac",
            max_nfev=300,
            **dict.fromkeys(("ftol", "xtol", "gtol"), 1e-12),
        )

    if begin is not None:
        starts = np.array([[*begin.values()]])
    else:
        # For estimates, a row is as wide as if its folds were shut.
        starts = _starts(period, strain, mean * (period / 4 if per_width else 1.0))
        # Without a stiffening strain, starts that differ in it alone are one.
        starts = starts if law == "stiffening" else starts[:: len(STARTING_STRAINS), :3]
    fits = [fit_to(mean, start) for start in _unknowns(starts)]
    best = min(fits, key=lambda fit: fit.cost)
    if len(record.force) >= MIN_REPEATS:
        # The fit to the mean curve is biased: folds of the repeats open at different strains.
        own = np.array([fit_to(each, best.x).x for each in record.force])
        fitted_at, errors = own.mean(axis=0), errors_by_scatter(own)
    else:
        order = np.argsort(strain, kind="stable")
        fitted_at, errors = best.x, errors_by_residuals(best.jac[order], best.fun[order])
    limits = fitted_at + np.outer([-1, 0, 1], errors.halfwidths)
    with np.errstate(over="ignore"):
        lows, values, highs = np.where(as_logarithm, np.exp(limits), limits)
    intervals = np.stack([lows, highs], axis=-1)
    # An interior angle of a fold is between 0 and π.
    intervals[2] = np.clip(intervals[2], 0, np.pi)
    standard_errors = errors.standard_errors * np.where(as_logarithm, values, 1.0)
    undetermined, warnings = _undetermined(best, errors)
    return Calibration(
        period=period,
        values=dict(zip(fitted, values.tolist(), strict=True)),
        standard_errors=dict(zip(fitted, standard_errors.tolist(), strict=True)),
        per_width=per_width,
        law=law,
        intervals=dict(zip(fitted, map(tuple, intervals.tolist()), strict=True)),
        correlations=errors.correlations,
        strain=strain,
        force=mean,
        fitted_force=forces(fitted_at),
        starts=(len(fits), sum(np.allclose(fit.x, best.x, atol=1e-3) for fit in fits)),
        converged=bool(best.success),
        iterations=int(best.njev),
        undetermined=undetermined,
        warnings=warnings,
        repeats=len(record.force),
        degrees_of_freedom=errors.degrees_of_freedom,
        autocorrelation=errors.autocorrelation,
    )


@partial(jax.jit, static_argnums=(0, 1))
def _force(
    curve: SpringCurve | None,
    per_width: bool,
    unknowns: Float[Array, " fitted"],
    period: Float[Array, ""],
    strain: Float[Array, " point"],
    along: tuple[Float[Array, ""], CurveLaw] | None,
) -> Float[Array, " point"]:
    law = stripe_law(jnp.exp(unknowns[3]) if len(unknowns) > len(FITTED) else None, curve)
    across = jnp.exp(unknowns[0]), jnp.exp(unknowns[1]), unknowns[2], law
    sheet = PureStripe(period, *across, *(along or ()))
    # A row of a pure fabric is as wide as its cells are long.
    return tension_across(sheet, strain) / (sheet.cell if per_width else 1.0)


_force_slopes = jax.jit(jax.jacfwd(_force, argnums=2), static_argnums=(0, 1))


def _unknowns(values: Float[np.ndarray, "*any fitted"]) -> Float[np.ndarray, "*any fitted"]:
    return np.where(AS_LOGARITHM[: values.shape[-1]], np.log(values), values)


def _starts(period: float, strain: Points, force: Points) -> Float[np.ndarray, "start 4"]:
    half = strain <= (strain[0] + strain[-1]) / 2
    opening = np.sum(force[half] * strain[half]) / max(np.sum(strain[half] ** 2), 1e-12)
    starts = []
    choices = STARTING_ANGLES, STARTING_FACTORS, STARTING_FACTORS, STARTING_STRAINS
    for angle, stiff, soft, stiffening in itertools.product(*choices):
        cell = period / (4 * np.sin(angle / 2))
        # For a fold that opens slightly: F = k_t dθ / (ℓ cos θ/2) and dε = dθ / (2 tan θ/2).
        k_t = max(opening, 1e-9) * cell * np.cos(angle / 2) / (2 * np.tan(angle / 2))
        k_s = np.max(np.abs(force)) / (0.1 * cell)
        starts.append((stiff * k_s, soft * k_t, angle, stiffening))
    return np.array(starts)


def _undetermined(
    fit: OptimizeResult, errors: FitErrors
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Parameters on a bound, with a large error, or like another; and sentences on these."""
    warnings, unknown = [], dict[str, None]()
    # Whether a curve separates two parameters does not depend on the scatter of a few repeats.
    separable = FitErrors(covariance_of_unit_noise(fit.jac), math.inf).correlations
    standard_errors = errors.standard_errors
    fitted = FITTED_IF_STIFFENING[: len(fit.x)]
    if not fit.success:
        warnings.append(f"the fit did not converge ({fit.message}); do not use it")
    bounds = _unknowns(np.array([BOUNDS[name] for name in fitted]).T)
    to_bound = np.abs(bounds - fit.x).min(axis=0)
    spread = MODEL_ERROR * math.sqrt(len(fit.fun) / INDEPENDENT)
    model_errors = spread * np.sqrt(np.diag(covariance_of_unit_noise(fit.jac)))
    largest = zip(fitted, standard_errors, model_errors, to_bound, strict=True)
    for name, error, model_error, distance in largest:
        if distance < AT_BOUND:
            low, high = BOUNDS[name]
            warnings.append(f"{name} is at its bound ({low:g} to {high:g})")
        elif error > USELESS_ERROR:
            warnings.append(f"{name} is uncertain by more than half")
        elif name in OF_SPRINGS and model_error > USELESS_ERROR:
            model_error_text = f"an error of {MODEL_ERROR:.0%} of the largest force"
            warnings.append(f"{model_error_text} changes {name} by more than half")
        else:
            continue
        unknown[name] = None
    for one, other in itertools.combinations(range(len(fitted)), 2):
        vague = max(standard_errors[one], standard_errors[other]) > VAGUE_ERROR
        if vague and abs(separable[one, other]) > ALIKE_CORRELATION:
            warnings.append(
                f"the curve cannot separate {fitted[one]} and {fitted[other]} (correlation"
                f" {separable[one, other]:+.4f}); their standard errors are not reliable"
            )
            unknown |= {fitted[one]: None, fitted[other]: None}
    rho, misfit = errors.autocorrelation, math.sqrt(2 * fit.cost / len(fit.fun))
    if rho >= CORRELATED and misfit >= ROUND_OFF:
        independent = len(fit.fun) * (1 - rho) / (1 + rho)
        warnings.append(
            f"neighbouring residuals are correlated by {rho:.2f}: {len(fit.fun)} points count as"
            f" about {independent:.0f}, and errors are enlarged; measure three repeats, whose"
            " scatter gives the errors"
        )
    return tuple(unknown), tuple(warnings)
