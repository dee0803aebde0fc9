"""Windows of applied strain: interpolation and reduction of curves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import fault

STRAIN = "applied_strain"
"""Dimension of windows."""
PARTS = 64
"""Number of equal intervals of a window at whose ends a curve is interpolated."""

Curves = Float[np.ndarray, "design strain"]
Numbers = Float[np.ndarray, " design"]


@dataclass(frozen=True)
class StrainWindow:
    """A range of strains, or a single one.

    Attributes:
        start: first applied strain [1].
        stop: last applied strain, the same for a single one [1].
    """

    start: float
    stop: float

    @property
    def single(self) -> bool:
        """Whether it is one strain."""
        return self.start == self.stop

    def __str__(self) -> str:
        return f"{self.start:g}" if self.single else f"{self.start:g}:{self.stop:g}"

    @classmethod
    def of(cls, text: str, source: str) -> "StrainWindow":
        """The window of a text ``STRAIN`` or ``STRAIN:STRAIN``.

        Args:
            text: for example ``0.05:0.25``.
            source: where it occurs, for the message.

        Raises:
            BadInput: if it is not a window, or does not ascend from at least 0.
        """
        try:
            start, *rest = (float(part) for part in text.split(":"))
            (stop,) = rest or (start,)
        except ValueError:
            example = "give one strain or two, such as 0.05:0.25"
            raise fault(source, f"{text.strip()!r} is not a window of strain; {example}") from None
        if not 0 <= start <= stop < np.inf:
            raise fault(source, f"the window {text.strip()} does not ascend from at least 0")
        return cls(start, stop)

    def read(
        self, strains: Float[np.ndarray, " grid"], values: Curves
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, "design point"]]:
        """Curves over the window, interpolated linearly between simulated strains.

        Args:
            strains: strains of the curves, ascending [1].
            values: values of every design at these strains, NaN where missing.

        Returns:
            Strains of the window, ascending, and the curves at these, NaN where unknown. A variable
            without a value in the relaxed state, such as Poisson's ratio, takes that of the first
            strain.
        """
        values = without_gap_at_zero(strains, values)
        if self.single:
            at = np.array([self.start])
        else:
            inside = strains[(strains > self.start) & (strains < self.stop)]
            at = np.union1d(np.linspace(self.start, self.stop, PARTS + 1), inside)
        upper = np.clip(np.searchsorted(strains, at), 1, max(len(strains) - 1, 1))
        lower = upper - 1
        if len(strains) == 1:
            return at, np.where(np.isclose(at, strains[0]), values, np.nan)
        part = (at - strains[lower]) / (strains[upper] - strains[lower])
        # A simulated strain is not interpolated, as its neighbour may be missing.
        part = np.where(np.isclose(part, 0, atol=1e-9), 0, np.where(np.isclose(part, 1), 1, part))
        below = np.where(part < 1, values[:, lower], 0)
        above = np.where(part > 0, values[:, upper], 0)
        read = below * (1 - part) + above * part
        return at, np.where((part < 0) | (part > 1), np.nan, read)


def without_gap_at_zero(strains: Float[np.ndarray, " grid"], values: Curves) -> Curves:
    """Curves whose missing values at zero strain are those of the next strain."""
    if len(strains) < 2 or strains[0] != 0:
        return values
    first = np.where(np.isnan(values[:, :1]), values[:, 1:2], values[:, :1])
    return np.concatenate([first, values[:, 1:]], axis=1)


def _mean(at: np.ndarray, curves: Curves) -> Numbers:
    if len(at) == 1:
        return curves[:, 0]
    return np.trapezoid(curves, at, axis=1) / (at[-1] - at[0])


def _slope(at: np.ndarray, curves: Curves) -> Numbers:
    """Slope of the least-squares line through a curve; NaN at a single strain."""
    if len(at) == 1:
        return np.full(len(curves), np.nan)
    from_middle = at - (at[0] + at[-1]) / 2
    return np.trapezoid(curves * from_middle, at, axis=1) / np.trapezoid(from_middle**2, at)


def _linearity(at: np.ndarray, curves: Curves) -> Numbers:
    """R² of the least-squares line through a curve; NaN at a single strain or if it is constant."""
    if len(at) == 1:
        return np.full(len(curves), np.nan)
    from_middle = at - (at[0] + at[-1]) / 2
    explained = _slope(at, curves) ** 2 * np.trapezoid(from_middle**2, at)
    varied = np.trapezoid((curves - _mean(at, curves)[:, None]) ** 2, at, axis=1)
    return np.divide(explained, varied, out=np.full(len(curves), np.nan), where=varied > 0)


def _linearity_gradient(at: np.ndarray, curve: Float[np.ndarray, " point"]) -> np.ndarray:
    """Derivative of R² by the value of the curve at each strain."""
    unit = np.eye(len(at))
    from_mean = curve - _mean(at, curve[None])[0]
    moment = np.trapezoid((at - (at[0] + at[-1]) / 2) ** 2, at)
    slope, varied = _slope(at, curve[None])[0], np.trapezoid(from_mean**2, at)
    by_slope = 2 * slope * moment / varied * _slope(at, unit)
    return by_slope - 2 * slope**2 * moment / varied**2 * np.trapezoid(from_mean * unit, at, axis=1)


REDUCTIONS: dict[str, Callable[[np.ndarray, Curves], Numbers]] = {
    "mean": _mean,
    "slope": _slope,
    "linearity": _linearity,
    "spread": lambda at, curves: curves.max(axis=1) - curves.min(axis=1),
    "min": lambda at, curves: curves.min(axis=1),
    "max": lambda at, curves: curves.max(axis=1),
}
"""Reductions of a curve over a window: its mean, the slope and R² of its least-squares line, its
range, and its extremes. NaN if any value is missing."""


def gradient(reduction: str, at: np.ndarray, curve: Float[np.ndarray, " point"]) -> np.ndarray:
    """Derivative of a reduction by the value of the curve at each strain of the window.

    Args:
        reduction: name in :data:`REDUCTIONS`.
        at: strains of the window.
        curve: the curve at these, which determines where its extremes are.
    """
    if reduction == "linearity":
        return _linearity_gradient(at, curve)
    unit = np.eye(len(at))
    by_extremes = {
        "min": unit[np.argmin(curve)],
        "max": unit[np.argmax(curve)],
        "spread": unit[np.argmax(curve)] - unit[np.argmin(curve)],
    }
    # The others are linear.
    return by_extremes[reduction] if reduction in by_extremes else REDUCTIONS[reduction](at, unit)


def root_mean_square(at: np.ndarray, curves: Curves) -> Numbers:
    """Root mean square of curves over a window."""
    return np.sqrt(_mean(at, curves**2))
