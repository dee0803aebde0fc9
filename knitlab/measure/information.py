"""An information criterion: whether a curve justifies the additional parameter of another law."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

WORTH = 2.0
"""Difference of AICc above which one fit is preferred: about the penalty of one parameter."""

Residuals = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Comparison:
    """Two fits of one curve by least squares, compared by AICc.

    AICc = n ln(S/n) + 2K + 2K(K + 1)/(n − K − 1), with the sum S of squares of n residuals and K
    parameters, including the noise (Hurvich and Tsai, Biometrika 76, 297, 1989). This assumes
    independent residuals. Those of a measured curve are not independent, because the error of a
    model varies smoothly; a curve of many points then seems to justify any parameter. AICc is
    therefore also computed from the innovations r_i − ρ r_(i−1), with the autocorrelation ρ of
    neighbouring residuals of each fit as an additional parameter. Both fits are least-squares fits;
    they are not fitted again with correlated noise.

    Attributes:
        points: n.
        autocorrelation: ρ of the simpler fit and of the other.
        gain: AICc of the simpler fit minus that of the other, if residuals are independent.
        gain_if_correlated: the same if neighbours are correlated.
    """

    points: int
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


def compare(simpler: Residuals, other: Residuals, parameters: tuple[int, int]) -> Comparison:
    """Compare two fits of one curve.

    Args:
        simpler: residuals of the simpler fit, in the order of strain.
        other: residuals of the other fit.
        parameters: number of fitted parameters of each.
    """
    pair = simpler, other
    correlations = _autocorrelation(simpler), _autocorrelation(other)
    independent = [
        _aicc(residuals, count + 1) for residuals, count in zip(pair, parameters, strict=True)
    ]
    correlated = [
        _aicc(residuals[1:] - correlation * residuals[:-1], count + 2)
        for residuals, correlation, count in zip(pair, correlations, parameters, strict=True)
    ]
    return Comparison(
        len(simpler), correlations, independent[0] - independent[1], correlated[0] - correlated[1]
    )


def _autocorrelation(residuals: Residuals) -> float:
    """Autocorrelation of neighbours: slope of each residual against the one before."""
    square = float(residuals[:-1] @ residuals[:-1])
    return float(residuals[:-1] @ residuals[1:]) / square if square > 0 else 0.0


def _aicc(residuals: Residuals, parameters: int) -> float:
    spare = len(residuals) - parameters - 1
    if spare <= 0:
        return math.nan
    # Keeps the criterion finite for a fit without residuals.
    mean_square = max(float(np.mean(residuals**2)), np.finfo(float).tiny)
    penalty = 2 * parameters + 2 * parameters * (parameters + 1) / spare
    return len(residuals) * math.log(mean_square) + penalty
