"""Step length along the path of a tensile test: long where extrapolation is accurate."""

import math
from dataclasses import dataclass, replace

from knitlab.solvers.solver import SolverSettings

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
        length: the step.
        base: step of a path of which nothing is known.
        longest: largest step.
        smallest_part: part of the first step down to which steps are halved.
        smooth: whether to extrapolate the path quadratically.
    """

    length: float
    base: float
    longest: float
    smallest_part: float
    smooth: bool = False

    @classmethod
    def first(cls, settings: SolverSettings) -> "PathStep":
        """First step of a path. With drag its length is the time step and remains constant."""
        base = settings.path_step
        longest = base if settings.drag else LONGEST * base
        return cls(base, base, longest, settings.smallest_step)

    def towards(self, strain: float, target: float) -> float:
        """The next strain on the way to a target, which is reached in equal steps."""
        steps = math.ceil(abs(target - strain) / self.length - ROUND_OFF)
        return target if steps <= 1 else strain + (target - strain) / steps

    def smallest(self, distance: float) -> float:
        """Step on the way over a distance that is not halved again."""
        steps = math.ceil(distance / self.base - ROUND_OFF)
        return self.smallest_part * distance / steps * (1 + ROUND_OFF)

    def after(self, step: float, iterations: int) -> "PathStep":
        """The step after one that stayed on the branch."""
        length = abs(step)
        if iterations <= EASY:
            longer = max(self.length, 2 * length)
        elif iterations <= HARD:
            longer = max(self.length, min(2 * length, self.base))
        else:
            longer = max(length / 2, min(2 * length, self.base))
        return replace(self, length=min(longer, self.longest), smooth=iterations <= SMOOTH)

    def after_snap(self) -> "PathStep":
        """The step after one that left the branch for another."""
        return replace(self, length=self.base, smooth=False)

    def after_failure(self, step: float) -> "PathStep":
        """The step after one that is to be repeated."""
        return replace(self, length=abs(step) / 2, smooth=False)
