"""A pull along the courses."""

from dataclasses import dataclass
from typing import ClassVar

from knitlab.solvers.loads.load import Load, X


@dataclass(frozen=True)
class Weft(Load):
    """A pull along the courses; the sides are free."""

    kind: str = "weft"
    axis: ClassVar[int] = X
    prescribed: ClassVar[tuple[int, ...]] = (X,)
