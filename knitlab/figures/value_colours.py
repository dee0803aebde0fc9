"""Colours of values: about zero if some are negative, by decades if they span several."""

from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure

from knitlab.figures.style import SEQUENCE_COLOURS, STRAIN_COLOURS

Colour = tuple[float, float, float, float]

DECADES = 30.0
"""Ratio of the largest of positive values to their median above which colours follow decades.

To the smallest it would depend on a single value, such as a force of 1e-10 N at zero strain.
"""


@dataclass(frozen=True)
class ValueColours:
    """Colours of values.

    Attributes:
        norm: norm of the values.
        colours: the colour map.
        low: smallest value.
        high: largest value.
    """

    norm: mpl.colors.Normalize
    colours: mpl.colors.Colormap
    low: float
    high: float

    @classmethod
    def of(cls, values: np.ndarray, signed: bool = False) -> "ValueColours":
        """Colours that span values.

        Args:
            values: the values; those that are not finite are left out.
            signed: whether zero is white even if no value is negative.
        """
        finite = np.asarray(values, float)[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        if signed or low < 0:
            largest = max(abs(low), abs(high)) or 1.0
            norm = mpl.colors.Normalize(-largest, largest)
            return cls(norm, mpl.colormaps[STRAIN_COLOURS], low, high)
        if low > 0 and high / float(np.median(finite)) > DECADES:
            norm = mpl.colors.LogNorm(low, high)
        else:
            norm = mpl.colors.Normalize(low, high if high > low else low + 1.0)
        return cls(norm, mpl.colormaps[SEQUENCE_COLOURS], low, high)

    def __call__(self, value: float) -> Colour:
        """The colour of a value."""
        red, green, blue, opacity = self.colours(self.norm(value))
        return red, green, blue, opacity

    def bar(self, figure: Figure, axes: Axes | list[Axes], **look: Any) -> Colorbar:
        """Add a colour bar that spans the values, and nothing beyond them.

        Args:
            figure: the figure.
            axes: axes beside which the bar stands.
            look: further arguments of the bar, such as its label.
        """
        bar = figure.colorbar(mpl.cm.ScalarMappable(self.norm, self.colours), ax=axes, **look)
        if self.low < self.high:
            bar.ax.set_ylim(self.low, self.high)
        else:
            bar.set_ticks([self.low])
        return bar
