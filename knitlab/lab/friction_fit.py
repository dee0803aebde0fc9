"""Friction of a stripe: fitted to the loading cycles of its endless pure sheet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import sin

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline, PPoly
from scipy.optimize import OptimizeResult, least_squares

from knitlab.lab.calibration import BOUNDS, UNITS, SheetFit, calibrate
from knitlab.lab.calibration import FITTED as ELASTIC
from knitlab.lab.fit_statistics import (
    Comparison,
    compare,
    covariance_by_groups,
    covariance_of_unit_noise,
)
from knitlab.lab.tension_record import LoadingCycles, Passage, TensionRecord
from knitlab.model.settings import Friction

FRICTION = ("fold_friction", "fold_drift")
FITTED = (*ELASTIC, *FRICTION)
RANGES = BOUNDS | {"fold_friction": (0.0, 2.0), "fold_drift": (0.0, 1.0)}
STARTS = ((1e-3, 1e-3), (0.05, 0.01), (0.3, 0.01), (0.05, 0.1))  # friction [rad] and drift [1]
LOGARITHMS = 2  # of the fitted parameters, the first, are fitted as logarithms
VAGUE = 0.5  # standard error over the parameter, above which that is hardly determined
MAX_STEPS = 60  # to the angle of a fold in balance
LAST_STEP = 1e-9  # a step of Newton's method after which the angle is exact to round-off [rad]
NEWTON_STEPS = 8  # of the height of a cell in balance
TABLE, TABULATED = (0.5, 6.0), 20_001  # lengths of cells over their flat side, in a table
ALMOST_OPEN = 0.99  # length of a fold over that of the open one
WORN_OUT = 1e-9  # angle that is left to an open fold [rad]

Points = Float[np.ndarray, " point"]
Parameters = Float[np.ndarray, " fitted"]  # some of FITTED, k_s and k_t also as logarithms


@dataclass(frozen=True, kw_only=True)
class FrictionFit(SheetFit):
    """Stripe and friction [rad] whose sheet reproduces the cycles, with standard errors by name.

    Errors are the larger of those of independent points and of passages that differ as wholes.
    """

    cycles: LoadingCycles
    fitted: tuple[Float[np.ndarray, " _"], ...]  # forces of every passage
    comparison: Comparison  # with a stripe without friction and drift
    converged: bool
    iterations: int

    @property
    def friction(self) -> Friction:
        """The friction and drift, as simulations take them."""
        values = self.values
        return Friction(values["fold_friction"], fold_drift=values["fold_drift"])

    @property
    def settings(self) -> list[str]:
        """The same as settings of a workflow."""
        return [f"{name}={self.values[name]:.4g}" for name in FRICTION]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters of the stripe that the cycles hardly determine."""
        errors, values = self.standard_errors, self.values
        return tuple(name for name in ELASTIC if errors[name] > VAGUE * values[name])

    @property
    def misfit(self) -> float:
        """Root mean square difference between records and fit."""
        measured = np.concatenate([each.force for each in self.cycles.passages])
        return float(np.sqrt(np.mean((measured - np.concatenate(self.fitted)) ** 2)))

    @property
    def report(self) -> list[str]:
        """The fit in lines of text."""
        passages, gain = self.cycles.passages, self.comparison
        units = UNITS | {"fold_friction": "rad", "fold_drift": "1"}
        verdict = "the cycles do not decide whether there is friction or drift"
        if gain.wanted:
            verdict = "the cycles support friction and drift"
        elif gain.refused:
            verdict = "the cycles support a stripe without friction and drift"
        points = sum(len(each.strain) for each in passages)
        return [
            *(
                f"{name:13s} {value:.4g} ± {self.standard_errors[name]:.2g} {units[name]}"
                for name, value in self.values.items()
            ),
            f"misfit        {self.misfit:.2g} {self.force_unit} rms over {points} points of"
            f" {len(passages)} passages, {self.iterations} steps",
            f"friction      {verdict} (AICc {gain.gain:+.1f}, {gain.gain_if_correlated:+.1f} if"
            " neighbours are correlated)",
        ]


def fit_friction(period: float, cycles: LoadingCycles) -> FrictionFit:
    """Fit a stripe, its friction and drift to passages; ValueError if there are fewer than two."""
    passages, per_width = cycles.passages, cycles.per_width
    if len(passages) < 2:
        raise ValueError("there is one loading alone; give unloading, or repeats of one swatch")
    first = next((each for each in passages if each.loading), passages[0])
    start = calibrate(period, TensionRecord(first.strain, first.force[None], per_width))
    measured = np.concatenate([each.force for each in passages])
    scale = float(np.abs(measured).max())
    bounds = np.array([RANGES[name] for name in FITTED]).T
    lower, upper = (_unknowns(each) for each in bounds)
    elastic = _unknowns(np.array([start.values[name] for name in ELASTIC]))

    def forces(unknowns: Parameters) -> list[Float[np.ndarray, " _"]]:
        return list(sheet_forces(period, _parameters(unknowns), passages, per_width))

    def fit(number: int, begin: Parameters) -> OptimizeResult:
        rest = np.zeros(len(FITTED) - number)
        return least_squares(
            lambda x: (np.concatenate(forces(np.append(x, rest))) - measured) / scale,
            np.clip(begin, lower[:number], upper[:number]),
            bounds=(lower[:number], upper[:number]),
            x_scale=np.array([1.0, 1.0, 1.0, 0.1, 0.01])[:number],
            xtol=1e-10,
            ftol=1e-10,
        )

    plain = fit(len(ELASTIC), elastic)
    fits = [fit(len(FITTED), np.append(plain.x, begin)) for begin in STARTS]
    best = min(fits, key=lambda each: each.cost)
    freedom = max(len(measured) - len(FITTED), 1)
    # Repeats differ as wholes: then the scores of passages, not of points, are independent.
    sizes = [len(each.force) for each in passages]
    point_covariance = 2 * best.cost / freedom * covariance_of_unit_noise(best.jac)
    group_covariance = covariance_by_groups(best.jac, best.fun, sizes)
    errors = np.sqrt(np.maximum(np.diag(point_covariance), np.diag(group_covariance)))
    values = _parameters(best.x)
    errors[:LOGARITHMS] *= values[:LOGARITHMS]
    return FrictionFit(
        period=period,
        values=dict(zip(FITTED, values.tolist(), strict=True)),
        standard_errors=dict(zip(FITTED, errors.tolist(), strict=True)),
        per_width=per_width,
        cycles=cycles,
        fitted=tuple(forces(best.x)),
        comparison=compare(plain.fun, best.fun, (len(ELASTIC), len(FITTED))),
        converged=bool(best.success),
        iterations=int(best.nfev),
    )


def _unknowns(parameters: Parameters) -> Parameters:
    return np.concatenate([np.log(parameters[:LOGARITHMS]), parameters[LOGARITHMS:]])


def _parameters(unknowns: Parameters) -> Parameters:
    return np.concatenate([np.exp(unknowns[:LOGARITHMS]), unknowns[LOGARITHMS:]])


@dataclass(frozen=True)
class _Fold:
    """The folds of a sheet since their last reversal: angle and friction moment there."""

    k_s: float
    k_t: float
    rest: float
    cell: float
    yields: float
    stiffness: float
    angle: float
    moment: float = 0.0

    def friction(self, angle: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        turned = self.moment + self.stiffness * (angle - self.angle)
        return np.clip(turned, -self.yields, self.yields)

    def angles(self, length: Points) -> Points:
        """Angles at half lengths, both springs in balance, by Newton's method and halving [rad]."""
        low, high = np.full(len(length), 0.01), np.full(len(length), np.pi - WORN_OUT)
        # Where springs hardly stretch.
        angle = 2 * np.arcsin(np.minimum(length / self.cell, ALMOST_OPEN))
        for _ in range(MAX_STEPS):
            half = np.tan(angle / 2)
            spring = length / np.sin(angle / 2)
            relative, steep = cell_pull(spring / self.cell)
            pull, friction = self.k_s * self.cell * relative, self.friction(angle)
            left = self.k_t * (angle - self.rest) + friction - pull * spring / half
            sticks = np.abs(friction) < self.yields
            slope = self.k_t + sticks * self.stiffness + pull * spring / 2 * (1 + 2 / half**2)
            slope += self.k_s * steep * (spring / half) ** 2 / 2
            low = np.where(left < 0, angle, low)
            high = np.where(left < 0, high, angle)
            step = angle - left / slope
            inside = (step > low - LAST_STEP) & (step < high + LAST_STEP)
            moved = np.where(inside, np.clip(step, low, high), (low + high) / 2) - angle
            angle = angle + moved
            if inside.all() and np.abs(moved).max() < LAST_STEP:
                break
        return angle

    def slack(self) -> float:
        """The angle without force, where spring and friction balance [rad]."""
        turned = self.k_t * self.rest + self.stiffness * self.angle - self.moment
        spring = self.k_t * (self.rest - (turned / (self.k_t + self.stiffness)))
        return self.rest - min(max(spring, -self.yields), self.yields) / self.k_t

    def forces(self, length: Points, angle: Points) -> Points:
        """Tension at half lengths and their angles; none where it is slack [N]."""
        half = np.sin(angle / 2)
        relative, _ = cell_pull(length / half / self.cell)
        return np.maximum(self.k_s * self.cell * relative / half, 0.0)

    def reversed_at(self, angle: float) -> "_Fold":
        return replace(self, angle=angle, moment=float(self.friction(np.array(angle))))


def cell_pull(
    length: Float[np.ndarray, "*any"],
) -> tuple[Float[np.ndarray, "*any"], Float[np.ndarray, "*any"]]:
    """Force over k_s and side of a square cell at a length over its side, and its slope."""
    spline, slope = _pulls()
    inside = np.clip(length, *TABLE)
    steep = slope(inside)
    return spline(inside) + steep * (length - inside), steep


@cache
def _pulls() -> tuple[CubicSpline, PPoly]:
    length = np.linspace(*TABLE, TABULATED)
    height = np.ones_like(length)
    for _ in range(NEWTON_STEPS):
        diagonal = np.hypot(length, height)
        left = height - 1 + 2 * (1 - np.sqrt(2) / diagonal) * height
        height = height - left / (3 - 2 * np.sqrt(2) * length**2 / diagonal**3)
    pull = length - 1 + 2 * (1 - np.sqrt(2) / np.hypot(length, height)) * length
    spline = CubicSpline(length, pull)
    return spline, spline.derivative()


def sheet_forces(
    period: float, parameters: Parameters, passages: Sequence[Passage], per_width: bool = False
) -> Iterator[Float[np.ndarray, " _"]]:
    """Forces of a sheet with the :data:`FITTED` parameters at the strains of every passage."""
    k_s, k_t, rest, friction, drift = parameters.tolist()
    quarter = period / 4
    yields, cell = k_t * friction, quarter / sin(rest / 2)
    fold, peaks = _Fold(k_s, k_t, rest, cell, yields, yields / Friction().fold_slide, rest), 0
    for number, passage in enumerate(passages):
        length = quarter * (1 + passage.strain)
        if passage.loading and number and passages[number - 1].loading:
            fold = fold.reversed_at(fold.slack())
        angles = fold.angles(length)
        yield fold.forces(length, angles) / (cell if per_width else 1.0)
        end = float(angles[-1])
        fold = fold.reversed_at(end if passage.loading else max(end, fold.slack()))
        if passage.loading:
            peaks += 1
            fold = replace(fold, rest=fold.rest + drift / peaks * (end - fold.rest))
            (held,) = fold.angles(length[-1:]).tolist()
            fold = fold.reversed_at(held)
