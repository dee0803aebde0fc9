"""Friction of a stripe: fitted to the loading cycles of its endless pure sheet."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline, PPoly
from scipy.optimize import OptimizeResult, least_squares

from knitlab.lab.calibration import BOUNDS, UNITS, calibrate
from knitlab.lab.fit_statistics import Comparison, compare, covariance_of_unit_noise
from knitlab.model.fold_friction import Friction
from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.settings import CellSize
from knitlab.model.stripe import Knit, Stripe

ELASTIC = ("k_s", "k_t", "theta_0")
FITTED = (*ELASTIC, "fold_friction", "fold_drift")
RANGES = BOUNDS | {"fold_friction": (0.0, 2.0), "fold_drift": (0.0, 1.0)}
STARTS = ((1e-3, 1e-3), (0.05, 0.01), (0.3, 0.01), (0.05, 0.1))  # friction [rad] and drift [1]
LOGARITHMS = 2  # of the fitted numbers, the first, are fitted as logarithms
VAGUE = 0.5  # standard error over the number, above which that is hardly determined
BISECTIONS = 60
NEWTON_STEPS = 8  # of the height of a cell in balance
TABLE, TABULATED = (0.5, 6.0), 20_001  # lengths of cells over their flat side, in a table
WORN_OUT = 1e-9  # angle that is left to an open fold [rad]

Points = Float[np.ndarray, " point"]
Numbers = Float[np.ndarray, " fitted"]  # some of FITTED, k_s and k_t also as logarithms


@dataclass(frozen=True)
class Passage:
    """Records of one loading or unloading, in order; strains are of the relaxed fabric [1]."""

    strain: Points
    force: Points
    loading: bool


@dataclass(frozen=True)
class LoadingCycles:
    """Passages of one swatch in their order, the first of the relaxed fabric."""

    passages: tuple[Passage, ...]
    per_width: bool = False  # whether forces are over the width [N/mm], not on one row [N]
    summary: tuple[str, ...] = ()  # what was subtracted, and how strains were moved


@dataclass(frozen=True)
class FrictionFit:
    """Stripe and friction whose sheet reproduces the cycles, with standard errors by name.

    Errors are the larger of those of independent points and of passages that differ as wholes.

    ``fold_friction`` is in rad; the others are those of a calibration.
    """

    period: float  # relaxed [mm]
    values: dict[str, float]
    standard_errors: dict[str, float]
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
        """The same as text, for ``--set``."""
        return [f"{name}={self.values[name]:.4g}" for name in ("fold_friction", "fold_drift")]

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

    def stripe(self, knit: Knit, n: int, cell_size: CellSize = "flat") -> Stripe:
        """The fitted stripe, as that of :meth:`knitlab.lab.calibration.Calibration.stripe`."""
        flat = self.period / math.sin(self.values["theta_0"] / 2)
        period = flat if cell_size == "flat" else self.period
        numbers: dict[str, Any] = {name: self.values[name] for name in ELASTIC}
        row = flat / CELLS_PER_PERIOD if self.cycles.per_width else None
        return Stripe(knit, n, period, **numbers, row_width=row)


def fit_friction(period: float, cycles: LoadingCycles) -> FrictionFit:
    """Fit a stripe, its friction and its drift together to all passages, in their order.

    Between two loadings the fabric is
    unloaded; where it has no force it is slack. The fit begins at a calibration of the first
    loading. ValueError if fewer than two passages are given, which tell nothing of friction.
    """
    passages, per_width = cycles.passages, cycles.per_width
    if len(passages) < 2:
        raise ValueError("there is one loading alone; give unloading, or repeats of one swatch")
    first = next((each for each in passages if each.loading), passages[0])
    start = calibrate(period, first.strain, first.force, per_width=per_width)
    measured = np.concatenate([each.force for each in passages])
    scale = float(np.abs(measured).max())
    bounds = np.array([RANGES[name] for name in FITTED]).T
    lower, upper = (_unknowns(each) for each in bounds)
    elastic = _unknowns(np.array([start.values[name] for name in ELASTIC]))

    def forces(unknowns: Numbers) -> list[Float[np.ndarray, " _"]]:
        return list(sheet_forces(period, _numbers(unknowns), passages, per_width))

    def fit(number: int, begin: Numbers) -> OptimizeResult:
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
    inverse = covariance_of_unit_noise(best.jac)
    freedom = max(len(measured) - len(FITTED), 1)
    # Repeats differ as wholes: then the scores of passages, not of points, are independent.
    ends = np.cumsum([len(each.force) for each in passages])[:-1]
    by_passage = zip(np.split(best.jac, ends), np.split(best.fun, ends), strict=True)
    scores = np.array([slopes.T @ residuals for slopes, residuals in by_passage])
    several = len(passages) / (len(passages) - 1)
    of_passages = several * inverse @ (scores.T @ scores) @ inverse
    variances = np.maximum(np.diag(2 * best.cost / freedom * inverse), np.diag(of_passages))
    errors = np.sqrt(variances)
    values = _numbers(best.x)
    errors[:LOGARITHMS] *= values[:LOGARITHMS]
    return FrictionFit(
        period,
        dict(zip(FITTED, values.tolist(), strict=True)),
        dict(zip(FITTED, errors.tolist(), strict=True)),
        cycles,
        tuple(forces(best.x)),
        compare(plain.fun, best.fun, (len(ELASTIC), len(FITTED))),
        bool(best.success),
        int(best.nfev),
    )


def _unknowns(numbers: Numbers) -> Numbers:
    return np.concatenate([np.log(numbers[:LOGARITHMS]), numbers[LOGARITHMS:]])


def _numbers(unknowns: Numbers) -> Numbers:
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
        """Angles at half lengths of a fold along the pull, of both its springs in balance [rad]."""
        low = np.full(len(length), 0.01)
        high = np.full(len(length), np.pi - WORN_OUT)
        for _ in range(BISECTIONS):
            angle = (low + high) / 2
            spring = length / np.sin(angle / 2)
            pull = self.k_s * self.cell * cell_pull(spring / self.cell)
            turned = self.moment + self.stiffness * (angle - self.angle)
            moment = self.k_t * (angle - self.rest) + np.clip(turned, -self.yields, self.yields)
            open_further = moment < pull * spring / np.tan(angle / 2)
            low, high = np.where(open_further, angle, low), np.where(open_further, high, angle)
        return (low + high) / 2

    def slack(self) -> float:
        """The angle without force, where spring and friction balance [rad]."""
        turned = self.k_t * self.rest + self.stiffness * self.angle - self.moment
        sticking = turned / (self.k_t + self.stiffness)
        spring = self.k_t * (self.rest - sticking)
        return self.rest - min(max(spring, -self.yields), self.yields) / self.k_t

    def forces(self, length: Points) -> Points:
        """Tension at half lengths; none where it is slack [N]."""
        angle = self.angles(length)
        pull = self.k_s * self.cell * cell_pull(length / np.sin(angle / 2) / self.cell)
        return np.maximum(pull / np.sin(angle / 2), 0.0)

    def reversed_at(self, angle: float) -> "_Fold":
        return replace(self, angle=angle, moment=float(self.friction(np.array(angle))))


def cell_pull(length: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """Force across the ridges of a square cell whose height is free, over k_s and its flat side.

    Its springs are linear and equal, diagonals too; ``length`` is over the flat side. Between the
    ends of its table it is exact to 1e-13, beyond them it is continued as a line.
    """
    spline, slope = _pulls()
    inside = np.clip(length, *TABLE)
    return spline(inside) + slope(inside) * (length - inside)


@cache
def _pulls() -> tuple[CubicSpline, PPoly]:
    """The forces of cells in balance, tabulated, and their slope."""
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
    period: float, numbers: Numbers, passages: Sequence[Passage], per_width: bool = False
) -> Iterator[Float[np.ndarray, " _"]]:
    """Forces of a sheet with the :data:`FITTED` numbers at the strains of every passage.

    A fold is a scalar return mapping in closed form, as no fold turns back within a passage.
    """
    k_s, k_t, rest, friction, drift = numbers.tolist()
    quarter = period / 4
    yields, cell = k_t * friction, quarter / math.sin(rest / 2)
    slide = yields / Friction().fold_slide
    fold, peaks = _Fold(k_s, k_t, rest, cell, yields, slide, rest), 0
    for number, passage in enumerate(passages):
        length = quarter * (1 + passage.strain)
        if passage.loading and number and passages[number - 1].loading:
            fold = fold.reversed_at(fold.slack())
        yield fold.forces(length) / (cell if per_width else 1.0)
        (end,) = fold.angles(length[-1:]).tolist()
        fold = fold.reversed_at(end if passage.loading else max(end, fold.slack()))
        if passage.loading:
            peaks += 1
            fold = replace(fold, rest=fold.rest + drift / peaks * (end - fold.rest))
            (held,) = fold.angles(length[-1:]).tolist()
            fold = fold.reversed_at(held)


def friction_report(fit: FrictionFit) -> list[str]:
    """The fit in lines of text."""
    passages, unit = fit.cycles.passages, "N/mm" if fit.cycles.per_width else "N"
    units = UNITS | {"fold_friction": "rad", "fold_drift": "1"}
    gain = fit.comparison
    if gain.wanted:
        verdict = "the cycles support friction and drift"
    elif gain.refused:
        verdict = "the cycles support a stripe without friction and drift"
    else:
        verdict = "the cycles do not decide whether there is friction or drift"
    points = sum(len(each.strain) for each in passages)
    return [
        *(
            f"{name:13s} {value:.4g} ± {fit.standard_errors[name]:.2g} {units[name]}"
            for name, value in fit.values.items()
        ),
        f"misfit        {fit.misfit:.2g} {unit} rms over {points} points of {len(passages)}"
        f" passages, {fit.iterations} steps",
        f"friction      {verdict} (AICc {gain.gain:+.1f}, {gain.gain_if_correlated:+.1f} if"
        " neighbours are correlated)",
    ]
