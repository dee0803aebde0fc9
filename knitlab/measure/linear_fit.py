"""Straight lines through measured values, with confidence intervals of their slopes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

CONFIDENCE = 0.95


@dataclass(frozen=True)
class LinearFit:
    """A least-squares line y = intercept + slope × x.

    Attributes:
        slope, intercept: parameters of the line.
        slope_halfwidth: half the 95 % confidence interval of the slope, by Student's t.
        r_squared: fraction of the variance of y that the line explains.
        x, y: the points.
    """

    slope: float
    intercept: float
    slope_halfwidth: float
    r_squared: float
    x: Float[np.ndarray, " point"]
    y: Float[np.ndarray, " point"]

    @property
    def residuals(self) -> Float[np.ndarray, " point"]:
        """Differences between y and the line."""
        return self.y - self.intercept - self.slope * self.x


def linear_fit(x: Float[np.ndarray, " point"], y: Float[np.ndarray, " point"]) -> LinearFit:
    """The line through at least three points.

    Raises:
        ValueError: if there are fewer, from which the error of a slope cannot be estimated.
    """
    if len(x) < 3:
        raise ValueError(f"{len(x)} points give no confidence interval of a slope; give 3 at least")
    found = stats.linregress(x, y)
    quantile = stats.t.ppf((1 + CONFIDENCE) / 2, len(x) - 2)
    return LinearFit(
        slope=float(found.slope),
        intercept=float(found.intercept),
        slope_halfwidth=float(quantile * found.stderr),
        r_squared=float(found.rvalue**2),
        x=np.asarray(x, float),
        y=np.asarray(y, float),
    )


def common_slope_probability(lines: Sequence[LinearFit]) -> float:
    """Probability of slopes as different as these if all lines had one slope (F test).

    The points of all lines are assumed to have the same variance. Simulated points hardly scatter,
    so that even slopes that are equal for all practical purposes differ significantly.
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
