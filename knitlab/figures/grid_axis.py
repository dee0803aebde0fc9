"""The axis of a grid of cells: numbers on a linear or logarithmic scale, or categories."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

MOST_NAMED = 16
"""Largest number of values that have a tick each."""
STEADY = 1e-6
"""Relative difference of steps, or of ratios, that counts as none."""


@dataclass(frozen=True)
class GridAxis:
    """The axis of a grid of cells.

    Attributes:
        edges: edges of the cells.
        centres: centres of the cells.
        labels: text of every value.
        scale: ``linear`` or ``log``.
        named: whether every value has a tick.
        whole: whether ticks are whole numbers.
    """

    edges: Float[np.ndarray, " edge"]
    centres: Float[np.ndarray, " cell"]
    labels: list[str]
    scale: str
    named: bool
    whole: bool = False

    @classmethod
    def of(cls, values: np.ndarray) -> "GridAxis":
        """The axis of the values of a dimension.

        Numbers at even steps have a linear scale, those at a constant ratio a logarithmic one.
        Text, and a few numbers at any distances, are categories: cells of one width.

        Args:
            values: values along the dimension, in ascending order if they are numbers.
        """
        labels = [_label(value) for value in values]
        named = len(values) <= MOST_NAMED
        if values.dtype.kind not in "iuf" or len(values) < 3:
            return cls._of_categories(labels)
        numbers = values.astype(float)
        steps = np.diff(numbers)
        if np.ptp(steps) <= STEADY * np.abs(steps).max():
            whole = values.dtype.kind in "iu"
            return cls(_edges(numbers), numbers, labels, "linear", named, whole)
        if (numbers > 0).all():
            ratios = np.diff(np.log(numbers))
            if np.ptp(ratios) <= STEADY * np.abs(ratios).max():
                return cls(np.exp(_edges(np.log(numbers))), numbers, labels, "log", named)
        if named:
            return cls._of_categories(labels)
        return cls(_edges(numbers), numbers, labels, "linear", named)

    @classmethod
    def _of_categories(cls, labels: list[str]) -> "GridAxis":
        places = np.arange(len(labels), dtype=float)
        return cls(np.arange(len(labels) + 1) - 0.5, places, labels, "linear", True)

    def settings(self, name: str) -> dict[str, Any]:
        """Arguments of ``Axes.set`` for the axis ``x`` or ``y``."""
        chosen: dict[str, Any] = {
            f"{name}scale": self.scale,
            f"{name}lim": (self.edges[0], self.edges[-1]),
        }
        if self.named:
            chosen |= {f"{name}ticks": self.centres, f"{name}ticklabels": self.labels}
        return chosen


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges halfway between centres."""
    middles = (centres[:-1] + centres[1:]) / 2
    return np.concatenate([[2 * centres[0] - middles[0]], middles, [2 * centres[-1] - middles[-1]]])


def _label(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float | np.number) else str(value)
