"""An information criterion: whether a curve wants the further parameter of another law."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

WORTH = 2.0
"""Difference of AICc from which on one fit is preferred: a further parameter costs about that."""


@dataclass(frozen=True)
class Comparison:
    """Two fits of one curve by least squares, compared by AICc.

    AICc = N ln(S/n) + 2K + 2K(K + 1)/(N − K − 1), with the sum S of squares of n residuals and K
    parameters, the noise among them (Hurvich and Tsai, Biometrika 76, 297, 1989). N is n if
    residuals are independent. Those of a measured curve are not, as what a model misses is
    smooth: then n points tell as much as N = n (1 − ρ)/(1 + ρ) independent ones, with the
    autocorrelation ρ of neighbouring residuals of the better fit. Without that any curve of many
    points seems to want any parameter.

    Attributes:
        points: n.
        autocorrelation: ρ, 0 where it is negative.
        gain: AICc of the simpler fit less that of the other, with N = n.
        gain_if_correlated: the same with N as above; not a number where N is too small for it.
    """

    points: int
    autocorrelation: float
    gain: float
    gain_if_correlated: float

    @property
    def independent_points(self) -> float:
        """N."""
        return self.points * (1 - self.autocorrelation) / (1 + self.autocorrelation)

    @property
    def wanted(self) -> bool:
        """Whether the curve wants the other fit, correlation taken into account."""
        return self.gain_if_correlated > WORTH

    @property
    def refused(self) -> bool:
        """Whether it wants the simpler one."""
        return self.gain_if_correlated < -WORTH


def compare(
    simpler: Float[np.ndarray, " point"],
    other: Float[np.ndarray, " point"],
    parameters: tuple[int, int],
) -> Comparison:
    """Compare two fits of one curve.

    Args:
        simpler: residuals of the simpler fit, in the order of strain.
        other: those of the other.
        parameters: how many numbers each fitted.
    """
    better = min((simpler, other), key=lambda residuals: float(residuals @ residuals))
    points, centred = len(better), better - better.mean()
    square = float(centred @ centred)
    correlation = float(centred[:-1] @ centred[1:]) / square if square > 0 else 0.0
    correlation = max(correlation, 0.0)
    found = Comparison(points, correlation, math.nan, math.nan)

    def gain(independent: float) -> float:
        one, two = (
            _aicc(residuals, count + 1, independent)
            for residuals, count in zip((simpler, other), parameters, strict=True)
        )
        return one - two

    return Comparison(points, correlation, gain(points), gain(found.independent_points))


def _aicc(
    residuals: Float[np.ndarray, " point"], parameters: int, independent: float
) -> float:
    spare = independent - parameters - 1
    if spare <= 0:
        return math.nan
    # The square of round-off, for a fit without any residual.
    mean_square = max(float(np.mean(residuals**2)), np.finfo(float).tiny)
    penalty = 2 * parameters + 2 * parameters * (parameters + 1) / spare
    return independent * math.log(mean_square) + penalty
