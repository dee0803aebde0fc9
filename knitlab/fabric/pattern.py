"""Patterns: which patch is rib, garter or plain knit, how large it is, and which stripe it has."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Int
from pydantic import Field

from knitlab.fabric.setting_types import RestAngle

CELLS_PER_PERIOD = 4
"""Grid cells along one period in the paper: two per stripe (Fig. 1F: grid of size w/4)."""

Knit = Literal["rib", "garter", "plain"]
KNIT_OF_LETTER: dict[str, Knit] = {"R": "rib", "G": "garter", "P": "plain"}
LETTERS = "R for rib, G for garter and P for plain knit"

Along = Literal["wale", "course"]
"""Direction of a line of the fabric: along a wale, up the warp, or along a course, in the weft."""
Patches = Annotated[float, Field(ge=0)]
"""A position or a length in patches of the pattern: 1.5 is the middle of the second patch."""


class BadPattern(ValueError):
    """A pattern that cannot be knitted.

    Attributes:
        problems: a sentence for each fault, with its place.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


@dataclass(frozen=True)
class SingleFold:
    """A single fold line of a pattern.

    Attributes:
        along: direction of the line.
        at: its position: patches from the left edge of the pattern to a line along a wale, from
            the lower edge to a line along a course. It must be on a grid line.
        start, end: start and end of the line, in patches; without ``end`` it ends at the edge of
            the pattern.
        sense: mountain or valley.
        theta_0: its interior rest angle; π is flat [rad].
    """

    along: Along
    at: Patches
    theta_0: RestAngle
    sense: Literal["mountain", "valley"] = "mountain"
    start: Patches = 0.0
    end: Patches | None = None

    @property
    def rest_fold(self) -> float:
        """The signed fold angle at rest, positive for a mountain [rad]."""
        return (np.pi - self.theta_0) * (1 if self.sense == "mountain" else -1)


@dataclass(frozen=True)
class GridFold:
    """A single fold on the grid.

    Attributes:
        along: direction of the fold.
        line: the grid line on which it lies.
        start, end: grid lines at its start and end.
        rest_fold: signed fold angle at rest [rad].
    """

    along: Along
    line: int
    start: int
    end: int
    rest_fold: float


@dataclass(frozen=True, eq=False)
class PatchGrid:
    """Patches in rows and columns, each with its knit; row 0 is the lowest, column 0 the leftmost.

    All patches of a column have the same number of wales, and all patches of a row the same number
    of courses, so that the stitches of neighbours match. A column has one width and one rib stripe,
    a row one height and one garter stripe.

    Attributes:
        knit: letter of every patch, see :data:`KNIT_OF_LETTER`.
        row_periods: height of each row, in periods of its garter stripe.
        column_periods: width of each column, in periods of its rib stripe.
        row_stripe: number of the garter stripe of each row, from 0.
        column_stripe: number of the rib stripe of each column, from 0.
        folds: single folds.
        cells_per_period: grid cells along one period.
    """

    knit: np.ndarray
    row_periods: Int[np.ndarray, " patch_y"]
    column_periods: Int[np.ndarray, " patch_x"]
    row_stripe: Int[np.ndarray, " patch_y"] = field(default_factory=lambda: np.zeros(0, int))
    column_stripe: Int[np.ndarray, " patch_x"] = field(default_factory=lambda: np.zeros(0, int))
    folds: tuple[SingleFold, ...] = ()
    cells_per_period: int = CELLS_PER_PERIOD

    def __post_init__(self) -> None:
        for name, count in zip(("row_stripe", "column_stripe"), self.knit.shape, strict=True):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(count, int))

    @property
    def patch_of_row(self) -> Int[np.ndarray, " grid_y"]:
        """The row of patches that contains each row of grid cells."""
        return np.repeat(np.arange(len(self.row_periods)), self.cells_per_period * self.row_periods)

    @property
    def patch_of_column(self) -> Int[np.ndarray, " grid_x"]:
        """The column of patches that contains each column of grid cells."""
        periods = self.column_periods
        return np.repeat(np.arange(len(periods)), self.cells_per_period * periods)

    @property
    def row_borders(self) -> Int[np.ndarray, " border"]:
        """Grid lines at the borders of rows of patches."""
        return self.cells_per_period * np.concatenate([[0], np.cumsum(self.row_periods)])

    @property
    def column_borders(self) -> Int[np.ndarray, " border"]:
        """Grid lines at the borders of columns of patches."""
        return self.cells_per_period * np.concatenate([[0], np.cumsum(self.column_periods)])

    @property
    def grid(self) -> tuple[int, int]:
        """Grid cells along (y, x)."""
        return int(self.row_borders[-1]), int(self.column_borders[-1])

    def cells_of(self, knit: Knit) -> Bool[np.ndarray, "grid_y grid_x"]:
        """Which grid cells lie in a patch of a knit."""
        of_patch = np.vectorize(KNIT_OF_LETTER.__getitem__, otypes=[object])(self.knit) == knit
        return of_patch[np.ix_(self.patch_of_row, self.patch_of_column)]

    def tiled(self, repeats: tuple[int, int]) -> "PatchGrid":
        """The pattern repeated along (y, x)."""
        rows, columns = self.knit.shape
        folds = [
            _moved(fold, turn_y * rows, turn_x * columns, rows, columns)
            for turn_y, turn_x in np.ndindex(repeats)
            for fold in self.folds
        ]
        along_y, along_x = repeats
        return replace(
            self,
            knit=np.tile(self.knit, repeats),
            row_periods=np.tile(self.row_periods, along_y),
            column_periods=np.tile(self.column_periods, along_x),
            row_stripe=np.tile(self.row_stripe, along_y),
            column_stripe=np.tile(self.column_stripe, along_x),
            folds=tuple(folds),
        )

    def grid_folds(self) -> tuple[GridFold, ...]:
        """The single folds on the grid.

        Raises:
            BadPattern: if folds lie outside the pattern or between grid lines; it lists them all.
        """
        problems: list[str] = []
        found = []
        for number, fold in enumerate(self.folds, 1):
            across, length = self.column_borders, self.row_borders
            if fold.along == "course":
                across, length = length, across
            end = len(length) - 1 if fold.end is None else fold.end
            lines: list[int] = []
            for name, place, borders in (
                ("at", fold.at, across),
                ("start", fold.start, length),
                ("end", end, length),
            ):
                line = _grid_line(place, borders)
                if isinstance(line, str):
                    problems.append(f"fold {number}: {name} = {place:g} {line}")
                else:
                    lines.append(line)
            if len(lines) < 3:
                continue
            line, start, last = lines
            if start >= last:
                problems.append(f"fold {number}: start = {fold.start:g} is not below end = {end:g}")
            found.append(GridFold(fold.along, line, start, last, fold.rest_fold))
        if problems:
            raise BadPattern(problems)
        return tuple(found)


def patch_map(rows: Sequence[str], periods: int) -> PatchGrid:
    """Pattern of equal patches from text, top course first.

    Args:
        rows: a letter for each patch: ``R`` for rib, ``G`` for garter, ``P`` for plain knit.
        periods: P, periods of a stripe across a patch.

    Raises:
        BadPattern: if the rows differ in length, are empty, or hold another letter.
    """
    knit = letters_of(rows)
    height, width = knit.shape
    return PatchGrid(knit, np.full(height, periods), np.full(width, periods))


def letters_of(rows: Sequence[str]) -> np.ndarray:
    """Letters (row, column) of a patch map, lowest row first.

    Raises:
        BadPattern: if the rows differ in length, are empty, or hold another letter.
    """
    widths = {len(row) for row in rows}
    if not rows or len(widths) != 1 or widths == {0}:
        lengths = ", ".join(f"row {k} has {len(row)}" for k, row in enumerate(rows, 1))
        problem = f"patch map {list(rows)} is not a rectangle; give rows of equal length"
        raise BadPattern([f"{problem} (from the top, {lengths} patches)" if rows else problem])
    problems = [
        f"patch map, row {row} from the top, column {column}: {letter!r} is not a knit;"
        f" use {LETTERS}"
        for row, letters in enumerate(rows, 1)
        for column, letter in enumerate(letters, 1)
        if letter.upper() not in KNIT_OF_LETTER
    ]
    if problems:
        raise BadPattern(problems)
    return np.array([list(row.upper()) for row in rows[::-1]])


def _moved(fold: SingleFold, up: int, right: int, rows: int, columns: int) -> SingleFold:
    across, along = (right, up) if fold.along == "wale" else (up, right)
    length = rows if fold.along == "wale" else columns
    end = length if fold.end is None else fold.end
    return replace(fold, at=fold.at + across, start=fold.start + along, end=end + along)


def _grid_line(place: float, borders: Int[np.ndarray, " border"]) -> int | str:
    """Grid line at a position in patches, or the fault of this position."""
    if not 0 <= place <= len(borders) - 1:
        return f"lies outside the pattern, which has {len(borders) - 1} patches there"
    patch = min(int(place), len(borders) - 2)
    cells = int(borders[patch + 1] - borders[patch])
    line = (place - patch) * cells
    if abs(line - round(line)) > 1e-6:
        near = sorted({int(line), int(line) + 1})
        places = " or ".join(f"{patch + k / cells:g}" for k in near)
        return f"lies between grid lines; use {places}"
    return int(borders[patch]) + round(line)
