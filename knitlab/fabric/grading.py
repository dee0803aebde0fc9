"""Grading: rows and columns of a pattern that differ in size or in their stripes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from knitlab.fabric.pattern import CELLS_PER_PERIOD, PatchGrid, SingleFold, letters_of
from knitlab.fabric.stripe import Stripe


@dataclass(frozen=True)
class Grading:
    """Sizes and stripes of every row and column of a pattern, rows from the top.

    Attributes:
        row_periods: height of each row of patches, in periods of its garter stripe.
        column_periods: width of each column of patches, in periods of its rib stripe.
        row_stripes: the garter stripe of each row.
        column_stripes: the rib stripe of each column.
    """

    row_periods: tuple[int, ...]
    column_periods: tuple[int, ...]
    row_stripes: tuple[Stripe, ...]
    column_stripes: tuple[Stripe, ...]

    @property
    def weft(self) -> tuple[Stripe, ...]:
        """The different rib stripes, in the order of the columns."""
        return tuple(dict.fromkeys(self.column_stripes))

    @property
    def warp(self) -> tuple[Stripe, ...]:
        """The different garter stripes, in the order of the rows from below."""
        return tuple(dict.fromkeys(self.row_stripes[::-1]))


@lru_cache(maxsize=256)
def graded_pattern(
    rows: tuple[str, ...],
    periods: int,
    repeats: tuple[int, int],
    grading: Grading | None = None,
    folds: tuple[SingleFold, ...] = (),
    cells_per_period: int = CELLS_PER_PERIOD,
) -> PatchGrid:
    """The pattern of a whole fabric.

    Args:
        rows: letters of the repeated patches, top course first.
        periods: P of every patch, if they are not graded.
        repeats: number of repeats along (y, x).
        grading: sizes and stripes of the rows and columns, if they are graded.
        folds: single folds of the repeated patches.
        cells_per_period: grid cells along one period.

    Raises:
        BadPattern: if the rows are not a map of patches.
    """
    knit = letters_of(rows)
    height, width = knit.shape
    if grading is None:
        pattern = PatchGrid(knit, np.full(height, periods), np.full(width, periods))
    else:
        pattern = PatchGrid(
            knit,
            row_periods=np.array(grading.row_periods[::-1]),
            column_periods=np.array(grading.column_periods),
            row_stripe=_numbers(grading.row_stripes[::-1], grading.warp),
            column_stripe=_numbers(grading.column_stripes, grading.weft),
        )
    return replace(pattern, folds=folds, cells_per_period=cells_per_period).tiled(repeats)


def recorded_pattern(
    record: Mapping[str, Any], repeats: tuple[int, int] | None = None
) -> PatchGrid:
    """The pattern of a whole fabric, from the record of its case.

    Args:
        record: record of a case of this or of an earlier version, as read from JSON.
        repeats: number of repeats along (y, x); by default that of the case.
    """
    along_y, along_x = repeats or record["unit_cells"]
    return graded_pattern(
        tuple(record["pattern"]),
        record["periods"],
        (along_y, along_x),
        TypeAdapter(Grading | None).validate_python(record.get("grading")),
        TypeAdapter(tuple[SingleFold, ...]).validate_python(record.get("folds", ())),
        record["reading"].get("cells_per_period", CELLS_PER_PERIOD),
    )


def _numbers(stripes: Sequence[Stripe], different: tuple[Stripe, ...]) -> np.ndarray:
    return np.array([different.index(stripe) for stripe in stripes])
