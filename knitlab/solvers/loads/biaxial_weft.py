"""A pull along the courses that also strains the wales."""

from dataclasses import dataclass
from typing import ClassVar

from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.load import X


@dataclass(frozen=True)
class BiaxialWeft(Biaxial):
    """A pull along both axes: ε along the weft, ``ratio`` times ε across it, along the warp.

    With a ratio of 0 the wales keep their length, as those of a sleeve between two cuffs.
    """

    kind: str = "biaxial_weft"
    axis: ClassVar[int] = X
