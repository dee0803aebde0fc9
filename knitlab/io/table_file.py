"""Tables of numbers in text, as machines and programs write them, and the units of their columns.

Separator, decimal mark, header and a row of units are recognised; blocks of properties above the
header are left out. What is ambiguous or incomplete is an error that names the line.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.io.errors import ErrorCollector, InputError, invalid, raise_if_any
from knitlab.io.limits import MAX_CHOICES
from knitlab.io.table_readings import (
    IN_BRACKETS,
    Block,
    Cell,
    Choice,
    Fits,
    Line,
    Sheets,
    is_unit,
    numeric_reading,
    text_ways,
)
from knitlab.io.text_file import read_text

WITH_UNIT = re.compile(rf"(?P<name>.*?)\s*(?P<unit>{IN_BRACKETS.pattern})")
BEHIND_WORD = re.compile(r"(?P<name>.+?)(?:\s+in|\s+/)\s+(?P<unit>\S+)")  # Kraft in N, F / N
WORKBOOKS = (".xlsx", ".xlsm")


class Table(NamedTuple):
    """A table of text: its headers, which may contain duplicates, and its rows.

    ``above`` are all rows of texts of its width directly above it, if there are several.
    """

    headers: list[str]
    rows: pd.DataFrame
    above: list[list[str]]
    sheet: str  # of a workbook
    place: str  # in its file


class Tables(NamedTuple):
    """The tables of a file that have the requested columns, and a sentence on the others."""

    tables: list[Table]
    unread: tuple[str, ...]


def read_tables(path: Path, example: str, fits: Fits, choice: Choice | None = None) -> Tables:
    """Read the tables of numbers whose header fits; their entries remain text.

    Numbers get a decimal point. Lines that start with # are ignored, except a header in the last of
    them. A row of units is joined to the header. If no header fits, it is the longest table.
    Messages name the line, or have the ``example`` of a table; without a ``choice``, they offer
    none.
    """
    commas, number = (choice or Choice()).commas, choice.table if choice else None
    if path.suffix.lower() in WORKBOOKS and path.is_file():
        ways = list(product([_workbook_sheets(path)], commas))
    else:
        ways = text_ways(read_text(path).split("\n"), commas)
    reading = numeric_reading(str(path), ways, choice is not None, fits)
    taken = reading.tables
    if not taken:
        raise invalid(str(path), f"has no table of numbers; {example}")
    if number is not None:
        if not 1 <= number <= len(taken):
            message = f"is not one of the {len(taken)} tables of {path}, at {places(taken)}"
            raise invalid(f"table {number}", f"{message}; give one of these")
        taken = taken[number - 1 : number]
    others = [
        block
        for block in reading.blocks
        if block not in taken and (block.is_table or block.line > taken[0].line)
    ]
    unread: tuple[str, ...] = ()
    if others or len(ways[0][0]) > 1:
        left = f"; not read: {places(others)}" if others else ""
        unread = (f"{path.name}: tables read: {places(taken)}{left}",)
    return Tables([_table(path, block, example) for block in taken], unread)


def read_table(
    path: Path, example: str, fits: Fits, choice: Choice | None = None
) -> tuple[Table, tuple[str, ...]]:
    """The table of a file whose header fits, and what is not read; InputError if it has several."""
    tables, unread = read_tables(path, example, fits, choice)
    if len(tables) > 1:
        raise several(path, tables, choice)
    return tables[0], unread


def several(path: Path, tables: list[Table], choice: Choice | None) -> InputError:
    """The error that one of some tables must be chosen."""
    shown = "; ".join(
        f"table {number} at {table.place}, {len(table.rows)} rows from"
        f" {', '.join(table.rows.iloc[0][:4])}"
        for number, table in enumerate(tables[:MAX_CHOICES], 1)
    )
    hint = "give table = NUMBER" if choice else "leave one of them"
    return invalid(str(path), f"has {len(tables)} tables: {shown}; {hint}")


def places(tables: Sequence[Table | Block]) -> str:
    """Where the first tables are, and how many more there are."""
    more = f" and {len(tables) - MAX_CHOICES} more" if len(tables) > MAX_CHOICES else ""
    return ", ".join(table.place for table in tables[:MAX_CHOICES]) + more


def column_numbers(path: Path, name: str, column: pd.Series) -> Float[np.ndarray, " point"]:
    """The numbers of a column; InputError names the first entry that is not a number."""
    values = pd.to_numeric(column, errors="coerce").to_numpy(float)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        value = repr(column.iloc[bad[0]]) if column.iloc[bad[0]] else "empty"
        message = f"point {bad[0] + 1} is {value}{more}, not a finite"
        raise invalid(f"{path}: column {name}", f"{message} number; give a record without it")
    return column.to_numpy(float)  # pandas 2 rounds the last digits of texts


class Columns(NamedTuple):
    """Numbers of columns by name, and a sentence on the tables of the file that are not read."""

    numbers: dict[str, Float[np.ndarray, " point"]]
    unread: tuple[str, ...]


def read_columns(
    path: Path,
    names: Mapping[str, str | None],
    example: str,
    optional: Collection[str] = (),
    choice: Choice | None = None,
    *,
    converts: bool = False,
) -> Columns:
    """Numbers of columns by name, whether or not the header adds a unit in brackets.

    ``names`` have the unit of each, or ``None``; ``optional`` columns are read if they are numbers.
    Another unit in a header is refused, as the user has stated one, or it is converted.
    """

    def fits(headers: list[str]) -> bool:
        return all(_columns_named(headers, name) for name in names)

    (headers, rows, *_), unread = read_table(path, example, fits, choice)
    columns, mistakes = {}, ErrorCollector()
    for name in (*names, *optional):
        with suppress(InputError) if name in optional else mistakes:
            known = _columns_named(headers, name)
            if len(known) != 1:
                message = f"is missing; the file has {', '.join(headers)}; {example}"
                message = "occurs twice; export it once" if known else message
                raise invalid(f"{path}: column {name}", message)
            where, header, unit = f"{path}: column {name}", headers[known[0]], names.get(name)
            columns[name] = column_numbers(path, name, rows[known[0]])
            if converts and unit is not None and (given := name_and_unit(header)[1]):
                columns[name] = columns[name] * unit_factor(where, given, unit, f"such as {unit}")
            else:
                _check_unit(where, header, unit)
    raise_if_any(mistakes.all)
    return Columns(columns, unread)


def _check_unit(where: str, header: str, stated: str | None) -> None:
    """InputError if a header has another unit than the stated one."""
    given = name_and_unit(header)[1]
    if stated is None or not (given and is_unit(given)):
        return
    with suppress(InputError):
        if np.isclose(unit_factor(where, given, stated, ""), 1):
            return
    message = f"is in {IN_BRACKETS.findall(header)[-1]} by its header, but {stated} is stated"
    raise invalid(where, f"{message}; state {given}")


def _columns_named(headers: list[str], name: str) -> list[int]:
    """The columns of a name, spelled as in the header, else without units, else in any case."""
    bare = [name_and_unit(header)[0] for header in headers]
    lower = [header.lower() for header in bare]
    spellings = (name, name_and_unit(name)[0])
    for known, wanted in product((headers, bare, lower), spellings):
        if wanted in known:
            return [column for column, header in enumerate(known) if header == wanted]
    return []


def name_and_unit(header: str) -> tuple[str, str]:
    """A header without the unit that ends it, and that unit: ``Load (N)`` or ``Load in N``."""
    if match := WITH_UNIT.fullmatch(header):
        return match["name"], match["unit"][1:-1].strip()
    match = BEHIND_WORD.fullmatch(header)
    return (match["name"], match["unit"]) if match and is_unit(match["unit"]) else (header, "")


def unit_factor(where: str, unit: str, target: str, hint: str) -> float:
    """Factor from one unit to another; ``hint`` names the units that InputError asks for."""
    import pint  # slow to import

    quantity = pint.get_application_registry().Quantity
    given, wanted = ("dimensionless" if each == "1" else each for each in (unit, target))
    message = f"is in {unit}; give it in a unit {hint}"
    try:
        once, twice = quantity(1.0, given), quantity(2.0, given)
        factor, double = (float(each.to(wanted).magnitude) for each in (once, twice))
        angle = target == "1" and not once.to_root_units().unitless
        if np.isclose(double, 2 * factor) and not angle:  # neither logarithmic nor an angle
            return factor
    except pint.DimensionalityError:
        pass
    except Exception:  # pint raises many types for a text that is not a unit
        message = f"has the unknown unit {unit!r}; give one {hint}"
    raise invalid(where, message)


def _table(path: Path, block: Block, example: str) -> Table:
    """A table whose rows are as long as its header; InputError names the line that is not."""
    first, headers = block.rows[0], block.headers
    if headers is None:
        count, next_count = len(block.above[-1].fields) if block.above else 0, len(first.fields)
        if count and block.above[-1].line == first.line - 1:
            message = f"has {count} fields, and the next line {next_count}; export it again"
            if next_count == 2 * count:
                message += ", or if the decimal mark is a comma, with semicolons between columns"
            raise invalid(f"{path}: line {first.line - 1}", message)
        shown = ", ".join(first.fields[:4])
        raise invalid(str(path), f"has no header above line {first.line} ({shown}); {example}")
    width = len(headers)
    for row in block.rows:
        if any(row.fields[width:]) or len(row.fields) < width:
            named = ", ".join(headers[:6])
            message = f"has {len(row.fields)} fields and the header {width} ({named}); export the"
            raise invalid(f"{path}: line {row.line}", f"{message} record again")
    rows = pd.DataFrame([row.fields[:width] for row in block.rows])
    return Table(headers, rows, [row.fields for row in block.above], block.sheet, block.place)


def _workbook_sheets(path: Path) -> Sheets:
    """The cells of each sheet of a workbook."""
    try:
        sheets = pd.read_excel(
            path, sheet_name=None, header=None, dtype=object, keep_default_na=False
        )
    except ImportError as error:
        message = "is an Excel workbook; export it as CSV, or install openpyxl"
        raise invalid(str(path), message) from error
    except (ValueError, KeyError, OSError, BadZipFile) as error:
        message = "is an Excel workbook that cannot be read; open it, and export it as CSV"
        raise invalid(str(path), message) from error
    return {name: _sheet_lines(sheet) for name, sheet in sheets.items()}


def _sheet_lines(sheet: pd.DataFrame) -> list[Line]:
    """Rows of a sheet without the empty cells at their end, but as long as the text above."""
    made: list[Line] = []
    width = 0
    for number, values in enumerate(sheet.to_numpy().tolist(), 1):
        cells = [_cell(value) for value in values]
        length = max((column for column, cell in enumerate(cells, 1) if cell != ""), default=0)
        if all(isinstance(cell, str) for cell in cells):
            width = length or width
        elif length < width:
            length = width
        if length:
            made.append((number, cells[:length]))
    return made


def _cell(value: Any) -> Cell:
    if isinstance(value, int | float) and not isinstance(value, bool) and value == value:
        return value
    return "" if pd.isna(value) else str(value).strip()
