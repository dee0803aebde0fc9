"""Types of settings: the range and the unit of a setting are part of its declared type.

``z_max: Annotated[PositiveFloat, Unit("mm")]`` in a table such as
:class:`~knitlab.fabric.fabric.Sheet` is the only declaration of that setting: parameter files,
workflows, sweeps and the documentation derive from it (:mod:`knitlab.sweep.settings`).
"""

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field


@dataclass(frozen=True)
class Unit:
    """The unit of a setting; a setting without unit is dimensionless.

    Attributes:
        symbol: UDUNITS text.
    """

    symbol: str


Fraction = Annotated[float, Field(gt=0, le=1)]
"""A fraction, above 0 and at most 1."""
Position = Annotated[float, Field(ge=0, le=1)]
"""A position along a length, from 0 at its start to 1 at its end."""
RestAngle = Annotated[float, Field(gt=0, lt=math.pi), Unit("rad")]
"""Interior angle of a fold, below π, which is flat [rad]."""
