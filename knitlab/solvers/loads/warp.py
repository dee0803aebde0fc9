"""The paper's tensile test: a pull along the wales."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from knitlab.solvers.loads.load import Load

if TYPE_CHECKING:
    from knitlab.solvers.combination import Combination


@dataclass(frozen=True)
class Warp(Load):
    """A pull along the wales; the sides are free (paper, Sec. "Kinematics under tension").

    A clamped sample has its bottom row held and its top row displaced along y. Periodic fabric has
    L_y prescribed and L_x free.
    """

    kind: str = "warp"

    def conflicts(self, combination: "Combination") -> Iterator[str]:
        """Nothing: it is the load for which every method and measure was written."""
        return iter(())
