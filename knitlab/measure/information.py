"""An information criterion: whether a curve wants the further parameter of another law."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

WORTH = 2.0
"""Difference of AICc from which on one fit is preferred: a further parameter costs about that."""

Residuals = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Comparison:
    """Two fits of one curve by least squares, compared by AICc.

    AICc = n ln(S/n) + 2K + 2K(K + 1)/(n − K − 1), with the sum S of squares of n residuals and K
    parameters, the noise among them (Hurvich and Tsai, Biometrika 76, 297, 1989). That takes
    residuals as independent. Those of a measured curve are not, as what a model misses is smooth:
    any curve of many points then seems to want any parameter. So AICc is also taken of what is new
    in each residual, r_i − ρ r_(i−1), with each fit's own autocorrelation ρ of neighbours as one
    more parameter. The fits are those of least squares, not fitted again under that noise.

    Attributes:
        points: n.
        autocorrelation: ρ of the simpler fit and of the other.
        gain: AICc of the simpler fit less that of the other, if residuals are independent.
        gain_if_correlated: the same if neighbours are correlated.
    """

    points: int
    autocorrelation: tuple[float, float]
    gain: float
    gain_if_correlated: float

    @property
    def wanted(self) -> bool:
        """Whether the curve wants the other fit, correlated or not."""
        return min(self.gain, self.gain_if_correlated) > WORTH

    @property
    def refused(self) -> bool:
        """Whether it wants the simpler one, correlated or not."""
        return max(self.gain, self.gain_if_correlated) < -WORTH


def compare(simpler: Residuals, other: Residuals, parameters: tuple[int, int]) -> Comparison:
    """Compare two fits of one curve.

    Args:
        simpler: residuals of the simpler fit, in the order of strain.
        other: those of the other.
        parameters: how many numbers each fitted.
    """
    pair = simpler, other
    correlations = _autocorrelation(simpler), _autocorrelation(other)
    one, two = (_aicc(its, count + 1) for its, count in zip(pair, parameters, strict=True))
    new_one, new_two = (
        _aicc(its[1:] - correlation * its[:-1], count + 2)
        for its, correlation, count in zip(pair, correlations, parameters, strict=True)
    )
    return Comparison(len(simpler), correlations, one - two, new_one - new_two)


def _autocorrelation(residuals: Residuals) -> float:
    """Of neighbours: the slope of each residual by the one before."""
    square = float(residuals[:-1] @ residuals[:-1])
    return float(residuals[:-1] @ residuals[1:]) / square if square > 0 else 0.0


def _aicc(residuals: Residuals, parameters: int) -> float:
    spare = len(residuals) - parameters - 1
    if spare <= 0:
        return math.nan
    # A fit without any residual has a finite criterion too.
    mean_square = max(float(np.mean(residuals**2)), np.finfo(float).tiny)
    penalty = 2 * parameters + 2 * parameters * (parameters + 1) / spare
    return len(residuals) * math.log(mean_square) + penalty
