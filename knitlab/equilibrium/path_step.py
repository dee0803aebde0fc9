"""Step length along the path of a tensile test: long where extrapolation is accurate."""

import math
from dataclasses import dataclass, replace

from knitlab.equilibrium.settings import SolverSettings

ROUND_OFF = 1e-9
EASY = 4
"""Iterations of a step up to which the next one is twice as long."""
SMOOTH = 10
"""Iterations of a step up to which the path is extrapolated quadratically from it."""
HARD = 16
"""Iterations of a step above which the next one is half as long."""
LONGEST = 4
"""Largest step along a path that is easy to follow, over ``path_step``."""


@dataclass(frozen=True)
class PathStep:
    """Step of applied strain along a path.

    Attributes:
        settings: settings of the equilibrium solver.
        length: the step.
        smooth: whether to extrapolate the path quadratically.
    """

    settings: SolverSettings
    length: float
    smooth: bool = False

    @classmethod
    def first(cls, settings: SolverSettings) -> "PathStep":
        """First step of a path, and the first on another branch."""
        return cls(settings, settings.path_step)

    @property
    def longest(self) -> float:
        """Largest step. With drag a step is a time step, and remains constant."""
        return self.settings.path_step * (1 if self.settings.drag else LONGEST)

    def towards(self, strain: float, target: float) -> float:
        """The next strain on the way to a target, which is reached in equal steps."""
        steps = _steps(abs(target - strain), self.length)
        return target if steps == 1 else strain + (target - strain) / steps

    def smallest(self, distance: float) -> float:
        """Step on the way over a distance that is not halved again."""
        whole = distance / _steps(distance, self.settings.path_step)
        return self.settings.smallest_step * whole * (1 + ROUND_OFF)

    def after(self, step: float, iterations: int) -> "PathStep":
        """The step after one that stayed on the branch."""
        length, doubled = abs(step), 2 * abs(step)
        if iterations > EASY:
            doubled = min(doubled, self.settings.path_step)
        longer = max(length / 2 if iterations > HARD else self.length, doubled)
        return replace(self, length=min(longer, self.longest), smooth=iterations <= SMOOTH)

    def after_failure(self, step: float) -> "PathStep":
        """The step after one that is to be repeated."""
        return replace(self, length=abs(step) / 2, smooth=False)


def _steps(distance: float, longest: float) -> int:
    """Number of equal steps over a distance."""
    return max(math.ceil(distance / longest - ROUND_OFF), 1)
