"""Calibration: the stripe whose zigzag has a measured tension curve (paper, Sec. "2D model")."""

import itertools
import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import t as student_t

from knitlab.model.options import CellSize
from knitlab.model.stripe import Knit, Stripe
from knitlab.model.zigzag import Zigzag, tension

FITTED = ("k_s", "k_t", "theta_0")
"""What is fitted, in this order; the stiffnesses by their logarithms."""
UNITS = {"k_s": "N/mm", "k_t": "N", "theta_0": "rad"}
"""As the paper tabulates them; k_t per radian, so N mm for an edge."""
BOUNDS = {"k_s": (1e-4, 1e4), "k_t": (1e-7, 1e2), "theta_0": (0.05, np.pi - 0.05)}
"""Where each is looked for [N/mm, N mm, rad]."""
STARTING_ANGLES = (0.4, 0.8, 1.4)
STARTING_FACTORS = (0.3, 3.0)
CONFIDENCE = 0.95
ALIKE_CORRELATION = 0.99
VAGUE_ERROR = 0.1
USELESS_ERROR = 0.5
"""Standard error of a logarithm, or of the angle [rad], that leaves nothing known."""
AT_BOUND = 1e-3
"""How near a bound, in the fitted unknown, counts as at it."""
LEAST_POINTS = len(FITTED) + 1
INSIDE = {
    name: (low * (1 + 2 * AT_BOUND), high * (1 - 2 * AT_BOUND))
    for name, (low, high) in BOUNDS.items()
}
"""Values that are not at a bound."""


@dataclass(frozen=True)
class Calibration:
    """A fitted stripe, and how well the curve determines it.

    Attributes:
        period: relaxed peak-to-peak distance of the stripe, as given [mm].
        values: k_s [N/mm], k_t [N mm] and theta_0 [rad], by name.
        standard_errors: of each, in its unit.
        intervals: 95 % confidence interval of each, in its unit; of the angle within 0 to π.
        correlations: between the fitted, in the order of :data:`FITTED`.
        strain: of the curve [1].
        force: measured [N].
        fitted_force: of the zigzag [N].
        starts: how many starts there were, and how many of them ended at this fit.
        converged: whether the optimiser met its tolerances.
        iterations: Jacobians that the best start took.
        warnings: what the curve does not determine.
    """

    period: float
    values: dict[str, float]
    standard_errors: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    correlations: Float[np.ndarray, "3 3"]
    strain: Float[np.ndarray, " point"]
    force: Float[np.ndarray, " point"]
    fitted_force: Float[np.ndarray, " point"]
    starts: tuple[int, int]
    converged: bool
    iterations: int
    warnings: tuple[str, ...]

    @property
    def usable(self) -> bool:
        """Whether the fit converged, with no parameter at the bound of where it was looked for."""
        inside = (low < self.values[name] < high for name, (low, high) in INSIDE.items())
        return self.converged and all(inside)

    def tabulated_period(self, cell_size: CellSize) -> float:
        """Period with which the network has the springs and folds of the fitted zigzag [mm].

        A table's period is that of the relaxed stripe where ``cell_size`` is ``"relaxed"``, and of
        the flat one where it is ``"flat"``: then four grid cells, longer by 1/sin(θ0/2).
        """
        flat = cell_size == "flat"
        return self.period / math.sin(self.values["theta_0"] / 2) if flat else self.period

    def stripe(self, knit: Knit, n: int, cell_size: CellSize = "flat") -> Stripe:
        """The fitted stripe, as a design takes it.

        Args:
            knit: rib or garter.
            n: stitches across a stripe.
            cell_size: model option that the stripe is for, on which its period depends.
        """
        period = self.tabulated_period(cell_size)
        return Stripe(knit, n, period, **{name: self.values[name] for name in FITTED})

    @property
    def misfit(self) -> float:
        """Root of the mean square difference between curve and fit [N]."""
        return float(np.sqrt(np.mean((self.force - self.fitted_force) ** 2)))


def calibrate(
    period: float, strain: Float[np.ndarray, " point"], force: Float[np.ndarray, " point"]
) -> Calibration:
    """Fit k_s, k_t and θ0 of a zigzag to its tension curve by bounded least squares.

    Gradients are exact; of several starts the best fit is kept. Standard errors and correlations
    are those of the linearised fit, with the noise taken from the residual.

    Args:
        period: relaxed peak-to-peak distance, w or h [mm].
        strain: of the period, not negative [1].
        force: on one row of the network [N].

    Raises:
        ValueError: if there are no more points than parameters, or no force.
    """
    if len(strain) < LEAST_POINTS:
        raise ValueError(
            f"{len(strain)} points cannot determine {len(FITTED)} parameters and their errors;"
            f" give at least {LEAST_POINTS}"
        )
    scale = float(np.max(np.abs(force)))
    if not scale > 0:
        raise ValueError("the force is zero throughout; give a curve under tension")
    if not np.sum(strain * force) > 0:
        raise ValueError("the force falls with strain; give tension as positive")
    compiled, jacobian = (
        lambda unknowns, of=of: np.asarray(of(unknowns, period, strain))
        for of in (_force, _force_slopes)
    )
    lower, upper = (_unknowns({name: BOUNDS[name][side] for name in FITTED}) for side in (0, 1))
    fits = [
        least_squares(
            lambda unknowns: (compiled(unknowns) - force) / scale,
            np.clip(start, lower, upper),
            jac=lambda unknowns: jacobian(unknowns) / scale,
            bounds=(lower, upper),
            x_scale="jac",
            ftol=1e-12,
            xtol=1e-12,
            gtol=1e-12,
            max_nfev=300,
        )
        for start in _starts(period, strain, force)
    ]
    best = min(fits, key=lambda fit: fit.cost)
    agreeing = sum(np.allclose(fit.x, best.x, atol=1e-3) for fit in fits)
    covariance = _covariance(best)
    errors = np.sqrt(np.diag(covariance))
    correlations = covariance / np.outer(errors, errors)
    reach = errors * student_t.ppf((1 + CONFIDENCE) / 2, len(strain) - len(FITTED))
    values, lows, highs = (_numbers(best.x + shift) for shift in (0, -reach, reach))
    slopes = np.array([values["k_s"], values["k_t"], 1.0])
    # Beyond its bounds an angle is no fold.
    lows["theta_0"], highs["theta_0"] = np.clip([lows["theta_0"], highs["theta_0"]], 0, np.pi)
    return Calibration(
        period=period,
        values=values,
        standard_errors=dict(zip(FITTED, (errors * slopes).tolist(), strict=True)),
        intervals={name: (float(lows[name]), float(highs[name])) for name in FITTED},
        correlations=correlations,
        strain=strain,
        force=force,
        fitted_force=compiled(best.x),
        starts=(len(fits), agreeing),
        converged=bool(best.success),
        iterations=int(best.njev),
        warnings=_warnings(best, errors, correlations, lower, upper),
    )


def report(calibration: Calibration) -> list[str]:
    """The fit in lines of text: parameters with errors, correlations, misfit."""
    lines = [
        f"{name:8s} {calibration.values[name]:.5g} ± {calibration.standard_errors[name]:.2g}"
        f" {UNITS[name]}, 95 %: {low:.5g} to {high:.5g}"
        for name, (low, high) in calibration.intervals.items()
    ]
    lines += [
        f"correlation of {FITTED[one]} and {FITTED[other]}:"
        f" {calibration.correlations[one, other]:+.4f}"
        for one, other in itertools.combinations(range(len(FITTED)), 2)
    ]
    tried, agreeing = calibration.starts
    points = len(calibration.strain)
    return [
        *lines,
        f"misfit   {calibration.misfit:.2g} N rms over {points} points;"
        f" {agreeing} of {tried} starts agree, {calibration.iterations} steps",
    ]


@jax.jit
def _force(
    unknowns: Float[Array, "3"], period: Float[Array, ""], strain: Float[Array, " point"]
) -> Float[Array, " point"]:
    chain = Zigzag(period, jnp.exp(unknowns[0]), jnp.exp(unknowns[1]), unknowns[2])
    return tension(chain, strain)


_force_slopes = jax.jit(jax.jacfwd(_force))


def _unknowns(values: dict[str, float]) -> Float[np.ndarray, "3"]:
    return np.array([np.log(values["k_s"]), np.log(values["k_t"]), values["theta_0"]])


def _numbers(unknowns: Float[np.ndarray, "3"]) -> dict[str, float]:
    with np.errstate(over="ignore"):
        numbers = [*np.exp(unknowns[:2]), unknowns[2]]
    return dict(zip(FITTED, map(float, numbers), strict=True))


def _starts(
    period: float, strain: Float[np.ndarray, " point"], force: Float[np.ndarray, " point"]
) -> list[Float[np.ndarray, "3"]]:
    """Starts about the stiffnesses that the curve's size and its first half suggest."""
    half = strain <= (strain[0] + strain[-1]) / 2
    opening = np.sum(force[half] * strain[half]) / max(np.sum(strain[half] ** 2), 1e-12)
    starts = []
    for angle, stiff, soft in itertools.product(STARTING_ANGLES, *[STARTING_FACTORS] * 2):
        cell = period / (4 * np.sin(angle / 2))
        # A fold that opens a little: F = k_t dθ / (ℓ cos θ/2) and dε = dθ / (2 tan θ/2).
        k_t = max(opening, 1e-9) * cell * np.cos(angle / 2) / (2 * np.tan(angle / 2))
        k_s = np.max(np.abs(force)) / (0.1 * cell)
        starts.append(_unknowns({"k_s": stiff * k_s, "k_t": soft * k_t, "theta_0": angle}))
    return starts


def _covariance(fit: OptimizeResult) -> Float[np.ndarray, "3 3"]:
    freedom = len(fit.fun) - len(fit.x)
    _, singular, right = np.linalg.svd(fit.jac, full_matrices=False)
    # Round-off must not pass for information.
    singular = np.maximum(singular, np.finfo(float).eps * singular[0])
    return 2 * fit.cost / freedom * (right.T / singular**2) @ right


def _warnings(
    fit: OptimizeResult,
    errors: Float[np.ndarray, "3"],
    correlations: Float[np.ndarray, "3 3"],
    lower: Float[np.ndarray, "3"],
    upper: Float[np.ndarray, "3"],
) -> tuple[str, ...]:
    warnings = []
    if not fit.success:
        warnings.append(f"the fit did not converge ({fit.message}); do not use it")
    for place, name in enumerate(FITTED):
        if min(fit.x[place] - lower[place], upper[place] - fit.x[place]) < AT_BOUND:
            low, high = BOUNDS[name]
            warnings.append(
                f"{name} is at its bound ({low:g} to {high:g}): the curve does not fix it"
            )
        if errors[place] > USELESS_ERROR:
            warnings.append(f"{name} is uncertain by more than half; the curve does not fix it")
    for one, other in itertools.combinations(range(len(FITTED)), 2):
        vague = max(errors[one], errors[other]) > VAGUE_ERROR
        if vague and abs(correlations[one, other]) > ALIKE_CORRELATION:
            warnings.append(
                f"the curve cannot tell {FITTED[one]} from {FITTED[other]} (correlation"
                f" {correlations[one, other]:+.4f}); measure to larger strain, and trust no"
                " standard error meanwhile"
            )
    return tuple(warnings)
