"""Patterns: which patch is rib, garter or plain knit, how large it is, and which stripe it has."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Bool, Int
from pydantic import Field

from knitlab.io.errors import shown
from knitlab.io.limits import MAX_CHOICES, MAX_STITCHES
from knitlab.model.settings import RestAngle
from knitlab.model.stripe import Stripe

CELLS_PER_PERIOD = 4  # grid cells along one period in the paper: two per stripe (Fig. 1F)
Knit = Literal["rib", "garter", "plain"]
KNIT_OF_LETTER: dict[str, Knit] = {"R": "rib", "G": "garter", "P": "plain"}

Along = Literal["wale", "course"]  # of a line: up the warp, or in the weft
Patches = Annotated[float, Field(ge=0)]  # 1.5 is the middle of the second patch


class BadPattern(ValueError):
    """A pattern that cannot be knitted; ``messages`` has a sentence for each mistake."""

    def __init__(self, messages: Sequence[str]) -> None:
        super().__init__("; ".join(messages))
        self.messages = tuple(messages)


@dataclass(frozen=True)
class SingleFold:
    """A single fold line of a pattern.

    Attributes:
        along: direction of the line.
        at: its position: patches from the left edge of the pattern to a line along a wale, from
            the lower edge to a line along a course. It must be on a grid line.
        theta_0: its interior rest angle; π is flat [rad].
        sense: mountain or valley.
        start, end: start and end of the line, in patches; without ``end`` it ends at the edge of
            the pattern.
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

    def moved(self, up: int, right: int, rows: int, columns: int) -> "SingleFold":
        """The fold in the repeat that is so many patches up and right, of rows × columns."""
        across, along, length = (right, up, rows) if self.along == "wale" else (up, right, columns)
        end = length if self.end is None else self.end
        return replace(self, at=self.at + across, start=self.start + along, end=end + along)


@dataclass(frozen=True, eq=False)
class PatchGrid:
    """Patches in rows and columns, each with its knit; row 0 is the lowest, column 0 the leftmost.

    All patches of a column have one width in wales and one rib stripe, all of a row one height in
    courses and one garter stripe, so that the stitches of neighbours match.
    """

    knit: np.ndarray  # letters, see KNIT_OF_LETTER
    row_periods: Int[np.ndarray, " patch_y"]  # height, in periods of its garter stripe
    column_periods: Int[np.ndarray, " patch_x"]  # width, in periods of its rib stripe
    row_stripe: Int[np.ndarray, " patch_y"]  # number of its garter stripe, from 0
    column_stripe: Int[np.ndarray, " patch_x"]  # number of its rib stripe, from 0
    folds: tuple[SingleFold, ...] = ()
    cells_per_period: int = CELLS_PER_PERIOD

    @property
    def patch_of_row(self) -> Int[np.ndarray, " grid_y"]:
        """The row of patches that contains each row of grid cells."""
        return self._patch_of(self.row_periods)

    @property
    def patch_of_column(self) -> Int[np.ndarray, " grid_x"]:
        """The column of patches that contains each column of grid cells."""
        return self._patch_of(self.column_periods)

    def _patch_of(self, periods: Int[np.ndarray, " patch"]) -> Int[np.ndarray, " grid"]:
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

    def knit_cells(self, knit: Knit) -> Bool[np.ndarray, "grid_y grid_x"]:
        """Which grid cells lie in a patch of a knit."""
        of_patch = np.vectorize(KNIT_OF_LETTER.__getitem__, otypes=[object])(self.knit) == knit
        return of_patch[np.ix_(self.patch_of_row, self.patch_of_column)]

    def tiled(self, repeats: tuple[int, int]) -> "PatchGrid":
        """The pattern repeated along (y, x)."""
        rows, columns = self.knit.shape
        folds = [
            fold.moved(turn_y * rows, turn_x * columns, rows, columns)
            for turn_y, turn_x in np.ndindex(repeats)
            for fold in self.folds
        ]
        of_lines: dict[str, Any] = {
            f"{line}_{name}": np.tile(getattr(self, f"{line}_{name}"), times)
            for line, times in zip(("row", "column"), repeats, strict=True)
            for name in ("periods", "stripe")
        }
        return replace(self, knit=np.tile(self.knit, repeats), folds=tuple(folds), **of_lines)

    def grid_folds(self) -> list[tuple[SingleFold, int, int, int]]:
        """Single folds with grid line, start and end; :class:`BadPattern` names every mistake."""
        messages = list[str]()
        on_grid = []
        for number, fold in enumerate(self.folds, 1):
            across = self.column_borders if fold.along == "wale" else self.row_borders
            length = self.row_borders if fold.along == "wale" else self.column_borders
            end = len(length) - 1 if fold.end is None else fold.end
            lines = []
            for name, at in (("at", fold.at), ("start", fold.start), ("end", end)):
                try:
                    lines.append(_grid_line(at, across if name == "at" else length))
                except ValueError as error:
                    messages.append(f"fold {number}: {name} = {at:g} {error}")
            if len(lines) == 3:
                if lines[1] >= lines[2]:
                    message = f"start = {fold.start:g} is not below end = {end:g}"
                    messages.append(f"fold {number}: {message}")
                on_grid.append((fold, lines[0], lines[1], lines[2]))
        if messages:
            raise BadPattern(messages)
        return on_grid


def _grid_line(at: float, borders: Int[np.ndarray, " border"]) -> int:
    """Grid line at a position in patches; or ValueError if there is none."""
    if not 0 <= at <= len(borders) - 1:
        raise ValueError(f"lies outside the pattern, which has {len(borders) - 1} patches there")
    patch = min(int(at), len(borders) - 2)
    cells = int(borders[patch + 1] - borders[patch])
    line = (at - patch) * cells
    if abs(line - round(line)) > 1e-6:
        near = sorted({int(line), int(line) + 1})
        lines = " or ".join(f"{patch + k / cells:g}" for k in near)
        raise ValueError(f"lies between grid lines; use {lines}")
    return int(borders[patch]) + round(line)


def map_letters(rows: Sequence[str]) -> np.ndarray:
    """Letters (row, column) of a map, lowest row first, from its text; or :class:`BadPattern`."""
    if (number := sum(map(len, rows))) > MAX_STITCHES:
        raise BadPattern([f"patch map has {number:,} patches; give at most {MAX_STITCHES:,}"])
    widths = {len(row) for row in rows}
    if not rows or len(widths) != 1 or widths == {0}:
        listed = enumerate(rows[:MAX_CHOICES], 1)
        lengths = ", ".join(f"row {k} has {len(row)}" for k, row in listed)
        message = f"patch map {shown([*rows])} is not a rectangle; give rows of equal length"
        raise BadPattern([f"{message} (from the top, {lengths} patches)" if rows else message])
    unknown = (
        f"patch map, row {row} from the top, column {column}: {letter!r} is not a knit;"
        " use R for rib, G for garter and P for plain knit"
        for row, letters in enumerate(rows, 1)
        for column, letter in enumerate(letters, 1)
        if letter.upper() not in KNIT_OF_LETTER
    )
    if messages := [*islice(unknown, MAX_CHOICES)]:
        raise BadPattern(messages)
    return np.array([list(row.upper()) for row in rows[::-1]])


@dataclass(frozen=True)
class Grading:
    """Sizes in periods, and stripes, of every row (garter) and column (rib), rows from the top."""

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
    repeats: tuple[int, int] = (1, 1),
    grading: Grading | None = None,
    folds: tuple[SingleFold, ...] = (),
    cells_per_period: int = CELLS_PER_PERIOD,
) -> PatchGrid:
    """The pattern of a fabric: its letters, top course first, with sizes, and repeats (y, x)."""
    knit = map_letters(rows)
    if grading is None:
        height, width = knit.shape
        sizes = np.full(height, periods), np.full(width, periods)
        stripes = np.zeros(height, int), np.zeros(width, int)
    else:
        sizes = np.array(grading.row_periods[::-1]), np.array(grading.column_periods)
        stripes = (
            np.array([grading.warp.index(stripe) for stripe in grading.row_stripes[::-1]]),
            np.array([grading.weft.index(stripe) for stripe in grading.column_stripes]),
        )
    return PatchGrid(knit, *sizes, *stripes, folds, cells_per_period).tiled(repeats)
