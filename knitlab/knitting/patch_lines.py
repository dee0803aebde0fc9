"""Patch lines: the rows or the columns of patches of a case, in stitches."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH
from knitlab.simulation.case import Case


@dataclass(frozen=True, eq=False)
class PatchLines:
    """The rows of patches of a fabric in courses, or its columns in wales.

    Attributes:
        stripe: courses or wales across a stripe, in each of them.
        periods: periods of two stripes in each of them.
        cells_per_period: grid cells along one period.
    """

    stripe: Int[np.ndarray, " patch"]
    periods: Int[np.ndarray, " patch"]
    cells_per_period: int

    @cached_property
    def borders(self) -> Int[np.ndarray, " border"]:
        """Courses or wales at which they begin and end."""
        return np.concatenate([[0], np.cumsum(2 * self.stripe * self.periods)])

    @property
    def count(self) -> int:
        """All their courses or wales."""
        return int(self.borders[-1])

    @property
    def patch(self) -> Int[np.ndarray, " stitch"]:
        """The row or column that each course or wale lies in."""
        return np.repeat(np.arange(len(self.periods)), np.diff(self.borders))

    @property
    def in_first_stripe(self) -> Bool[np.ndarray, " stitch"]:
        """Whether each course or wale lies in the first, third, … stripe of its patch."""
        place = np.arange(self.count) - self.borders[self.patch]
        return place // self.stripe[self.patch] % 2 == 0

    @property
    def at_grid_lines(self) -> Float[np.ndarray, " line"]:
        """Courses or wales before each grid line of the model."""
        cells = self.cells_per_period * self.periods
        sizes = np.repeat(2 * self.stripe / self.cells_per_period, cells)
        return np.concatenate([[0], np.cumsum(sizes)])


def is_turned(case: Case) -> bool:
    """Whether the chart of a case is turned: pure rib has its ridges along x in the model."""
    return case.pure and case.weft.knit == "rib"


def patch_lines(case: Case) -> tuple[PatchLines, PatchLines]:
    """The rows and the columns of patches of a case.

    A pure stripe, which the model gives as many grid cells along its ridges as across them, takes
    a stripe's length of stitches for the same number of cells, by the stitch's shape of 1:2.
    """
    sample, grading = case.sample, case.grading
    warp = (case.warp,) if grading is None else grading.warp
    weft = (case.weft,) if grading is None else grading.weft
    rows = np.array([stripe.n for stripe in warp])[sample.row_stripe]
    columns = np.array([stripe.n for stripe in weft])[sample.column_stripe]
    if is_turned(case):
        columns = columns * GARTER_STITCHES_PER_RIB_STITCH
    elif case.pure:
        columns = np.maximum(1, columns // GARTER_STITCHES_PER_RIB_STITCH)
    cells = sample.cells_per_period
    return (
        PatchLines(rows, sample.row_periods, cells),
        PatchLines(columns, sample.column_periods, cells),
    )
