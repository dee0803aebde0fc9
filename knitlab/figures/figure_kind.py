"""What describes a figure that can be drawn by its name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from matplotlib.figure import Figure

from knitlab.cube.schema import DESIGN_DIMS


@dataclass(frozen=True)
class FigureKind:
    """One kind of figure.

    Attributes:
        draw: draws it from a cube, or from a case if ``needs`` names a variable, or from several
            cases if ``designs`` lists some. The first paragraph of its docstring describes the
            figure in the reference and in :mod:`knitlab.plot`.
        dims: design dimensions of the cubes that it can show; ``None`` for any.
        needs: variable that the case it shows must have.
        coordinates: further coordinates that it can be sliced along.
        designs: designs (n_stripe, n_subunit) whose cases it shows side by side; those that are
            missing are left out, and if all are, other designs are shown instead.
        options: names of keyword arguments that select what ``draw`` shows.
        several: whether it takes several cubes: any, or experiments beside one simulation.
    """

    draw: Callable[..., Figure]
    dims: tuple[str, ...] | None = DESIGN_DIMS
    needs: str | None = None
    designs: tuple[tuple[int, int], ...] = ()
    coordinates: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    several: Literal["any", "experiments"] | None = None

    @property
    def takes(self) -> str:
        """What it takes, for the documentation."""
        if self.several == "any":
            return "any number of cubes"
        if self.several == "experiments":
            return "one simulated cube or test, and any experiments"
        if self.designs:
            return "a cube with its case files"
        return "a test, or a cube with its case files" if self.needs else "a cube or a test"
