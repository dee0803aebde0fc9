"""Statistics of fits: errors, intervals of slopes, and whether data justify another parameter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats
from scipy.linalg import matmul_toeplitz

CONFIDENCE = 0.95
WORTH = 2.0  # AICc by which a fit is preferred: about the penalty of one parameter

Points = Float[np.ndarray, " point"]
Matrix = Float[np.ndarray, "fitted fitted"]
Jacobian = Float[np.ndarray, "point fitted"]
TRIED_CORRELATIONS = np.tanh(np.linspace(0, 2.65, 54))
"""Trial autocorrelations of residuals, from 0 to 0.99."""


@dataclass(frozen=True)
class FitErrors:
    """Errors of fitted parameters, with Student's intervals, and how neighbours are correlated."""

    covariance: Matrix
    degrees_of_freedom: float
    autocorrelation: float = 0.0

    @property
    def standard_errors(self) -> Float[np.ndarray, " fitted"]:
        """Square roots of the variances."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Matrix:
        """Correlations of the errors; 0 with a parameter that has no error."""
        scale = np.outer(self.standard_errors, self.standard_errors)
        return np.divide(self.covariance, scale, np.zeros_like(scale), where=scale > 0)

    @property
    def halfwidths(self) -> Float[np.ndarray, " fitted"]:
        """Half the 95 % intervals."""
        return self.standard_errors * quantile(self.degrees_of_freedom)


def quantile(degrees_of_freedom: float, confidence: float = CONFIDENCE) -> float:
    """Half the interval of Student's t over the standard error."""
    return float(stats.t.ppf((1 + confidence) / 2, degrees_of_freedom))


def errors_by_scatter(repeats: Float[np.ndarray, "repeat fitted"]) -> FitErrors:
    """Errors of the mean parameters of repeats, by their scatter."""
    return FitErrors(np.cov(repeats.T) / len(repeats), len(repeats) - 1)


def covariance_of_unit_noise(jacobian: Jacobian) -> Matrix:
    """Covariance of fitted parameters if all residuals are independent, with variance 1."""
    inverse = _inverse(jacobian)[1]
    return inverse @ inverse.T


def covariance_by_groups(jacobian: Jacobian, residuals: Points, sizes: Sequence[int]) -> Matrix:
    """Covariance of a fit to groups of points, of these sizes, that differ as wholes."""
    inverse, ends, count = covariance_of_unit_noise(jacobian), np.cumsum(sizes)[:-1], len(sizes)
    groups = zip(np.split(jacobian, ends), np.split(residuals, ends), strict=True)
    scores = np.array([slopes.T @ left for slopes, left in groups])
    return count / (count - 1) * inverse @ (scores.T @ scores) @ inverse


def errors_by_residuals(jacobian: Jacobian, residuals: Points) -> FitErrors:
    """Errors of a least-squares fit by its residuals, whose neighbours may be correlated.

    Residuals in order are taken as V_ij = σ² ρ^|i−j|. The covariance B V Bᵀ, with the Jacobian's
    pseudoinverse B, is averaged over ρ by its restricted likelihood (Harville, JASA 72, 320, 1977).
    Variances v are geometric means; 2/ν = 2/(n − p) + var(ln v) gives the degrees of freedom.
    """
    count, fitted = jacobian.shape
    span, inverse = _inverse(jacobian)
    spare = count - fitted
    log_weights, covariances = [], []
    for rho in TRIED_CORRELATIONS:
        # Innovations of unit variance, of the model and of the residuals.
        first = math.sqrt(1 - rho**2)
        model = np.concatenate([first * span[:1], span[1:] - rho * span[:-1]])
        left = np.concatenate([first * residuals[:1], residuals[1:] - rho * residuals[:-1]])
        basis, triangle = np.linalg.qr(model)
        left = left - basis @ (basis.T @ left)
        square = max(float(left @ left), np.finfo(float).tiny)
        log_weights.append(
            0.5 * math.log(1 - rho**2)
            - float(np.log(np.abs(np.diag(triangle))).sum())
            - spare / 2 * math.log(square)
        )
        correlated = matmul_toeplitz(rho ** np.arange(count), inverse.T)
        covariances.append(square / spare / (1 - rho**2) * inverse @ correlated)
    spacing = 1 - TRIED_CORRELATIONS**2
    prior = spacing / spacing.sum() + (TRIED_CORRELATIONS == 0)
    weights = prior * np.exp(np.array(log_weights) - max(log_weights))
    weights /= weights.sum()
    variances = np.log(np.diagonal(covariances, axis1=1, axis2=2))
    middle = weights @ variances
    scatter = weights @ (variances - middle) ** 2
    covariance = np.tensordot(weights, covariances, 1)
    scale = np.sqrt(np.exp(middle) / np.diag(covariance))
    return FitErrors(
        covariance * np.outer(scale, scale),
        2 / (2 / spare + float(scatter.mean())),
        float(weights @ TRIED_CORRELATIONS),
    )


def _inverse(jacobian: Jacobian) -> tuple[Jacobian, Float[np.ndarray, "fitted point"]]:
    """An orthonormal basis of the columns of a Jacobian, and its pseudoinverse."""
    span, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    # Round-off must not count as information.
    singular = np.maximum(singular, np.finfo(float).eps * singular[0])
    return span, (right.T / singular) @ span.T


@dataclass(frozen=True)
class Comparison:
    """Two fits of one curve, compared by AICc (Hurvich and Tsai, Biometrika 76, 297, 1989).

    Errors of a model vary smoothly, so that many points seem to justify any parameter. AICc is
    therefore also computed from the innovations r_i − ρ r_(i−1), with ρ as one more parameter. A
    gain is the AICc of the simpler fit minus that of the other; ρ is given in the same order.
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
    return LinearFit(
        slope=float(line.slope),
        intercept=float(line.intercept),
        slope_halfwidth=float(quantile(len(x) - 2) * line.stderr),
        r_squared=float(line.rvalue**2),
        x=np.asarray(x, float),
        y=np.asarray(y, float),
    )


def common_slope_probability(lines: Sequence[LinearFit]) -> float:
    """Probability of slopes as different as these if all lines had one slope (F test)."""
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
