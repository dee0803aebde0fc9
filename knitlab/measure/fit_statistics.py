"""Statistics of fits: confidence intervals of slopes, and whether data justify a parameter more."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

CONFIDENCE = 0.95
WORTH = 2.0  # AICc by which a fit is preferred: about the penalty of one parameter

Points = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Comparison:
    """Two fits of one curve by least squares, compared by AICc.

    AICc = n ln(S/n) + 2K + 2K(K + 1)/(n − K − 1), with the sum S of squares of n residuals and K
    parameters, including the noise (Hurvich and Tsai, Biometrika 76, 297, 1989). This assumes
    independent residuals, but the error of a model varies smoothly: a curve of many points then
    seems to justify any parameter. AICc is therefore also computed from the innovations
    r_i − ρ r_(i−1), with the autocorrelation ρ of neighbours as a parameter more.

    A gain is the AICc of the simpler fit minus that of the other; ρ is given in the same order.
    """

    autocorrelation: tuple[float, float]
    gain: float
    gain_if_correlated: float

    @property
    def wanted(self) -> bool:
        """Whether the other fit is preferred, with correlated residuals and without."""
        return min(self.gain, self.gain_if_correlated) > WORTH

    @property
    def refused(self) -> bool:
        """Whether the simpler fit is preferred, with correlated residuals and without."""
        return max(self.gain, self.gain_if_correlated) < -WORTH


def compare(simpler: Points, other: Points, parameters: tuple[int, int]) -> Comparison:
    """Compare two fits of one curve by residuals in order of strain, and numbers of parameters."""
    correlations = _autocorrelation(simpler), _autocorrelation(other)
    independent, correlated = [], []
    for residuals, rho, count in zip((simpler, other), correlations, parameters, strict=True):
        independent.append(_aicc(residuals, count + 1))
        correlated.append(_aicc(residuals[1:] - rho * residuals[:-1], count + 2))
    return Comparison(correlations, independent[0] - independent[1], correlated[0] - correlated[1])


def _autocorrelation(residuals: Points) -> float:
    square = float(residuals[:-1] @ residuals[:-1])
    return float(residuals[:-1] @ residuals[1:]) / square if square > 0 else 0.0


def _aicc(residuals: Points, parameters: int) -> float:
    spare = len(residuals) - parameters - 1
    if spare <= 0:
        return math.nan
    # Keeps the criterion finite for a fit without residuals.
    mean_square = max(float(np.mean(residuals**2)), np.finfo(float).tiny)
    penalty = 2 * parameters + 2 * parameters * (parameters + 1) / spare
    return len(residuals) * math.log(mean_square) + penalty


@dataclass(frozen=True)
class LinearFit:
    """A least-squares line with its R² and half the 95 % confidence interval of its slope."""

    slope: float
    intercept: float
    slope_halfwidth: float
    r_squared: float
    x: Points
    y: Points

    @property
    def residuals(self) -> Points:
        """Differences between y and the line."""
        return self.y - self.intercept - self.slope * self.x


def linear_fit(x: Points, y: Points) -> LinearFit:
    """The line through at least three points; ValueError if there are fewer."""
    if len(x) < 3:
        raise ValueError(f"{len(x)} points give no confidence interval of a slope; give 3 at least")
    line = stats.linregress(x, y)
    quantile = stats.t.ppf((1 + CONFIDENCE) / 2, len(x) - 2)
    return LinearFit(
        slope=float(line.slope),
        intercept=float(line.intercept),
        slope_halfwidth=float(quantile * line.stderr),
        r_squared=float(line.rvalue**2),
        x=np.asarray(x, float),
        y=np.asarray(y, float),
    )


def common_slope_probability(lines: Sequence[LinearFit]) -> float:
    """Probability of slopes as different as these if all lines had one slope (F test).

    Variances are assumed equal. Simulated points hardly scatter, so that slopes that are equal for
    all practical purposes differ significantly.
    """
    separate = sum(float((line.residuals**2).sum()) for line in lines)
    moments = [(line.x - line.x.mean(), line.y - line.y.mean()) for line in lines]
    slope = sum(float(x @ y) for x, y in moments) / sum(float(x @ x) for x, _ in moments)
    together = sum(float(((y - slope * x) ** 2).sum()) for x, y in moments)
    points, count = sum(len(line.x) for line in lines), len(lines)
    freedom = points - 2 * count
    if separate <= 0:
        return 1.0 if together <= 0 else 0.0
    statistic = (together - separate) / (count - 1) / (separate / freedom)
    return float(stats.f.sf(statistic, count - 1, freedom))
