"""Stitches: their size, which the gauge gives, and how many a unit cell and a fabric have."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import PositiveFloat

from knitlab.model.checked import Checked
from knitlab.model.settings import Unit


@dataclass(frozen=True)
class Gauge(Checked):
    """Size of a stitch before the fabric folds.

    Attributes:
        stitch_width: width along the course [mm].
        stitch_height: height along the wale [mm].
    """

    stitch_width: Annotated[PositiveFloat, Unit("mm")]
    stitch_height: Annotated[PositiveFloat, Unit("mm")]


@dataclass(frozen=True)
class Stitches:
    """Stitches along the sides of a unit cell, on average over the central ones, and of the fabric.

    The paper's unit cell has (64, 32) for n_subunit 16 (Fig. "knit stitches").
    """

    courses_in_cell: float
    wales_in_cell: float
    courses: float
    wales: float
