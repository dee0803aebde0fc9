"""Every figure that can be drawn by its name.

A module holds functions that draw, and ``FIGURES``, which describes each by its name.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from matplotlib.figure import Figure

from knitlab.observables.schema import DESIGN_DIMS


@dataclass(frozen=True)
class FigureKind:
    """One kind of figure.

    ``draw`` takes a cube, or a case if ``needs`` names a variable, or several cases if ``designs``
    lists some. The first paragraph of its docstring describes the figure in :mod:`knitlab.plot`.
    """

    draw: Callable[..., Figure]
    dims: tuple[str, ...] | None = DESIGN_DIMS  # of the cubes that it can show; None for any
    needs: str | None = None  # variable that the case must have
    designs: tuple[tuple[int, int], ...] = ()  # shown side by side; if all are missing, others
    coordinates: tuple[str, ...] = ()  # further ones that it can be sliced along
    options: tuple[str, ...] = ()  # keyword arguments that select what it shows
    several: Literal["any", "experiments"] | None = None  # cubes: any, or beside one simulation

    @property
    def takes(self) -> str:
        """What it takes, for the documentation."""
        if self.several:
            experiments = "one simulated cube or test, and any experiments"
            return "any number of cubes" if self.several == "any" else experiments
        if self.designs:
            return "a cube with its case files"
        return "a test, or a cube with its case files" if self.needs else "a cube or a test"
