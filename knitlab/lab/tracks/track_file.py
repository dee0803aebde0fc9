"""What a format of tracks is: the program that writes it, and how its files are read."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from knitlab.io.errors import invalid
from knitlab.io.table_file import (
    Table,
    Tables,
    column_numbers,
    name_and_unit,
    read_tables,
    several,
)
from knitlab.io.table_readings import Choice
from knitlab.io.text_file import read_text

Trajectories = Float[np.ndarray, "frame marker 2"]
YAxis = Literal["up", "down"]
EXAMPLE = "write it as in 'frame,marker,x,y'"
AXIS = re.compile(r"([xy])[ ._-]?\d*$")
"""End of the header of a coordinate, such as ``x``, ``position_y`` or ``x_12``."""


class Tracks(NamedTuple):
    """What a tracker has written, in pixels of its own axes."""

    positions: Trajectories  # NaN where a marker is lost
    frames: Float[np.ndarray, " frame"] | None = None  # their numbers, if the file has them
    confidence: Float[np.ndarray, "frame marker"] | None = None  # from 0 to 1, where stated
    unit: str = ""  # of the positions, if it is not the pixel
    time: Float[np.ndarray, " frame"] | None = None  # in place of numbers [s]


@dataclass(frozen=True)
class TrackFile:
    """A file of a tracker; text and table are read when a format first asks for them."""

    path: Path
    choice: Choice | None = None

    @property
    def is_table(self) -> bool:
        """Whether its suffix is that of a table."""
        return self.path.suffix.lower() in (".csv", ".txt", ".tsv", ".xlsx")

    @cached_property
    def text(self) -> str:
        """Its text; none of a workbook."""
        return "" if self.path.suffix.lower() == ".xlsx" else read_text(self.path).lstrip()

    @cached_property
    def tables(self) -> Tables:
        """Its tables with positions; entries are text."""
        return read_tables(self.path, EXAMPLE, _has_positions, self.choice)

    @cached_property
    def table(self) -> Table:
        """Its table; several of the same columns are joined, as rows name their frames."""
        first, *others = self.tables.tables
        if any(each.headers != first.headers for each in others):
            raise several(self.path, [first, *others], self.choice)
        rows = pd.concat([first.rows, *(each.rows for each in others)], ignore_index=True)
        return first._replace(rows=rows)

    @property
    def unread(self) -> tuple[str, ...]:
        """A sentence on the tables of the file that are not read."""
        return self.tables.unread if "tables" in self.__dict__ else ()

    def table_with(self, *columns: str) -> Table | None:
        """Its table, with lower-case headers from the row that has all these columns."""
        if self.is_table:
            for headers in [*self.table.above, self.table.headers]:
                lower = [name.lower() for name in headers[: len(self.table.headers)]]
                if set(columns) <= set(lower):
                    return self.table._replace(headers=lower)
        return None

    def column(
        self, table: Table, name: str, number: int | None = None
    ) -> Float[np.ndarray, " row"]:
        """Numbers of a column, by its header or its index, NaN where it is empty."""
        texts = table.rows[table.headers.index(name) if number is None else number]
        gap = texts.str.lower().isin(["", "nan"])
        values = np.full(len(texts), np.nan)
        values[~gap] = column_numbers(self.path, name, texts[~gap])
        return values

    def by_frame(
        self, table: Table, frame: str, marker: np.ndarray, names: list[str]
    ) -> tuple[Float[np.ndarray, " frame"], Float[np.ndarray, "frame marker value"]]:
        """Numbers of frames, and columns; NaN where a marker has no row, or the table no column."""
        known = {name: self.column(table, name) for name in names if name in table.headers}
        rows = pd.DataFrame(dict.fromkeys(names, np.nan) | known, index=range(len(marker)))
        index = whole_numbers(self.path, frame, self.column(table, frame))
        rows.index = pd.MultiIndex.from_arrays([index, marker])
        if rows.index.has_duplicates:
            twice = index[rows.index.duplicated()][0]
            message = f"has a marker twice in frame {twice}; export one track for each marker"
            raise invalid(str(self.path), message)
        frames = np.unique(index)
        values = rows.unstack().to_numpy().reshape(len(frames), len(names), -1).swapaxes(1, 2)
        return frames.astype(float), values

    def rows_of_positions(
        self, table: Table, frame: str, marker: str, x: str, y: str, unit: str = ""
    ) -> Tracks:
        """Tracks of a table with a row for each position; a marker without one is lost there."""
        markers = whole_numbers(self.path, marker, self.column(table, marker))
        frames, positions = self.by_frame(table, frame, markers, [x, y])
        return Tracks(positions, frames, unit=unit)


def _has_positions(headers: list[str]) -> bool:
    ends = (AXIS.search(name_and_unit(header)[0].lower()) for header in headers)
    return {end[1] for end in ends if end} == {"x", "y"}


@dataclass(frozen=True)
class TrackFormat:
    """A format of tracked markers."""

    program: str
    read: Callable[[TrackFile], Tracks | None]  # None if it does not recognise the file
    y_axis: YAxis = "down"  # direction in which y increases in the picture
    counts_from_0: bool = True  # whether frame 0 is surely the first of the video


def whole_numbers(
    path: Path, name: str, values: Float[np.ndarray, " row"]
) -> Int[np.ndarray, " row"]:
    """Values of a column as whole numbers from 0 up; InputError names the first that is none."""
    bad = np.flatnonzero(~((values % 1 == 0) & (values >= 0)))
    if len(bad):
        message = f"has {values[bad[0]]:g} at point {bad[0] + 1}; count from 0 up"
        raise invalid(f"{path}: column {name}", message)
    return values.astype(int)
