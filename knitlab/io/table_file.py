"""Tables of numbers in text, as machines and programs write them, and the units of their columns.

Separator, decimal mark, header and a row of units are recognised; blocks of properties above the
header are left out. What is ambiguous or incomplete is an error that names the line.
"""

import csv
import re
from collections.abc import Collection, Mapping, Sequence
from itertools import product, takewhile, zip_longest
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
import pandas as pd
import pint
from jaxtyping import Float

from knitlab.io.errors import Mistake, invalid, raise_if_any
from knitlab.io.text_file import read_text

SEPARATORS = ",;\t| "  # of columns; any number of spaces is one separator
NUMBER = re.compile(r"[+-]?((\d{1,3}(,\d{3})+|\d+)(\.\d*)?|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
"""A number with a decimal point, and perhaps commas between thousands."""
EXCHANGED = str.maketrans(".,", ",.")
IN_BRACKETS = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
WITH_UNIT = re.compile(rf"(?P<name>.*?)\s*(?P<unit>{IN_BRACKETS.pattern})")
BEHIND_WORD = re.compile(r"(?P<name>.+?)(?:\s+in|\s+/)\s+(?P<unit>\S+)")  # Kraft in N, F / N
WORKBOOKS = (".xlsx", ".xlsm")
SEEN = 400  # lines that decide on separator and decimal mark
OF_SPACES = 0.67  # weight of what spaces explain, as they are within texts too


class Table(NamedTuple):
    """A table of text: its headers, which may contain duplicates, and its rows.

    ``above`` are all rows of texts of its width directly above it, if there are several.
    """

    headers: list[str]
    rows: pd.DataFrame
    above: list[list[str]]


class _Row(NamedTuple):
    line: int  # from 1
    fields: list[str]  # of which numbers have a decimal point, and no marks between thousands
    numeric: bool  # whether any is a number


def read_table(path: Path, example: str) -> Table:
    """Read a table of numbers; its entries remain text, with a decimal point.

    Lines that start with # are ignored, except a header in the last of them. A row of units is
    joined to the header. Messages name the line, or have the ``example`` of a table.
    """
    if path.suffix.lower() in WORKBOOKS and path.is_file():
        lines, separator, comma = _workbook_lines(path), "\t", False
    else:
        lines = read_text(path).split("\n")
        # Excel states the separator in a first line such as ``sep=;``.
        if stated := re.fullmatch(r'"?sep=(.)"?', lines[0].strip()):
            lines[0] = ""
        separator, comma = _dialect(lines, stated[1] if stated else SEPARATORS)
    rows = []
    for number, line in enumerate(lines, 1):
        if _holds_fields(line):
            fields = _fields(line, separator)
            numbers = [_number(field, comma) for field in fields]
            plain = [number or field for number, field in zip(numbers, fields, strict=True)]
            rows.append(_Row(number, plain, any(numbers)))
    first = _first_of_table(rows)
    if first is None:
        raise invalid(str(path), f"has no table of numbers; {example}")
    headers = _headers(rows, first, lines, separator)
    if headers is None:
        begin, incomplete = rows[first], rows[first - 1]
        if incomplete.line == begin.line - 1:
            count, next_count = len(incomplete.fields), len(begin.fields)
            message = f"has {count} fields, and the next line {next_count}; correct the line"
            if next_count == 2 * count:
                message += ", or if the decimal mark is a comma, separate columns by semicolons"
            raise invalid(f"{path}: line {incomplete.line}", message)
        shown = ", ".join(_fields(lines[begin.line - 1], separator)[:4])
        raise invalid(str(path), f"has no header above line {begin.line} ({shown}); {example}")
    width = len(headers)
    for number, fields, _ in rows[first:]:
        if any(fields[width:]) or len(fields) < width:
            named = ", ".join(headers[:6])
            message = f"has {len(fields)} fields and the header {width} ({named}); correct the line"
            raise invalid(f"{path}: line {number}", message)
    texts = takewhile(lambda row: len(row.fields) == width and not row.numeric, rows[:first][::-1])
    above = [row.fields for row in texts][::-1]
    return Table(headers, pd.DataFrame([row.fields[:width] for row in rows[first:]]), above)


def column_numbers(
    path: Path, name: str, column: pd.Series
) -> tuple[Float[np.ndarray, " point"], list[Mistake]]:
    """The numbers of a column, and mistakes for the entries that are not numbers."""
    values = pd.to_numeric(column, errors="coerce").to_numpy(float)
    bad = np.flatnonzero(~np.isfinite(values))
    if not len(bad):
        return values, []
    more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
    value = repr(column.iloc[bad[0]]) if column.iloc[bad[0]] else "empty"
    message = f"point {bad[0] + 1} is {value}{more}, not a finite number; correct or remove it"
    return values, [Mistake(f"{path}: column {name}", message)]


def read_columns(
    path: Path, names: Mapping[str, str | None], example: str, optional: Collection[str] = ()
) -> dict[str, Float[np.ndarray, " point"]]:
    """Numbers of columns by name, whether or not the header adds a unit in brackets.

    ``names`` have the unit of each, or ``None``; ``optional`` columns are read if they are numbers.
    """
    headers, rows, _ = read_table(path, example)
    bare = [name_and_unit(header)[0] for header in headers]
    lower = [header.lower() for header in bare]
    columns, mistakes = {}, list[Mistake]()
    for name in (*names, *optional):
        where, spellings = f"{path}: column {name}", (name, name_and_unit(name)[0])
        pairs = product((headers, bare, lower), spellings)
        known, wanted = next((pair for pair in pairs if pair[1] in pair[0]), ([], name))
        if known.count(wanted) == 1:
            column = known.index(wanted)
            columns[name], wrong = column_numbers(path, name, rows[column])
            unit, given = names.get(name), name_and_unit(headers[column])[1]
            if unit is not None and given and _is_unit(given):
                factor, mistaken = unit_factor(where, given, unit, f"such as {unit}")
                if mistaken or not np.isclose(factor, 1):
                    shown = IN_BRACKETS.findall(headers[column])[-1]
                    message = f"is in {shown} by its header, but {unit} is stated; correct one"
                    wrong.insert(0, Mistake(where, message))
        else:
            message = f"is missing; the file has {', '.join(headers)}; {example}"
            wrong = [Mistake(where, "occurs twice; keep one" if known else message)]
        if name not in optional:
            mistakes += wrong
        elif wrong:
            columns.pop(name, None)
    raise_if_any(mistakes)
    return columns


def name_and_unit(header: str) -> tuple[str, str]:
    """A header without the unit that ends it, and that unit: ``Load (N)`` or ``Load in N``."""
    if match := WITH_UNIT.fullmatch(header):
        return match["name"], match["unit"][1:-1].strip()
    match = BEHIND_WORD.fullmatch(header)
    return (match["name"], match["unit"]) if match and _is_unit(match["unit"]) else (header, "")


def unit_factor(where: str, unit: str, target: str, hint: str) -> tuple[float, list[Mistake]]:
    """Factor from one unit to another, or a mistake; ``hint`` names accepted units."""
    quantity = pint.get_application_registry().Quantity
    given, wanted = ("dimensionless" if each == "1" else each for each in (unit, target))
    try:
        once, twice = quantity(1.0, given), quantity(2.0, given)
        factor, double = (float(each.to(wanted).magnitude) for each in (once, twice))
        angle = target == "1" and not once.to_root_units().unitless
        logarithmic = not np.isclose(double, 2 * factor)
        if not (angle or logarithmic):
            return factor, []
    except pint.DimensionalityError:
        pass
    except Exception:  # pint raises many types for a text that is not a unit
        return np.nan, [Mistake(where, f"has the unknown unit {unit!r}; give one {hint}")]
    return np.nan, [Mistake(where, f"is in {unit}; give it in a unit {hint}")]


def _workbook_lines(path: Path) -> list[str]:
    """The first sheet of a workbook as lines whose fields are separated by tabs."""
    try:
        sheet = pd.read_excel(path, header=None, dtype=str, keep_default_na=False)
    except ImportError as error:
        message = "is an Excel workbook; export it as CSV, or install openpyxl"
        raise invalid(str(path), message) from error
    except (ValueError, KeyError, OSError, BadZipFile) as error:
        message = "is an Excel workbook that cannot be read; open it, and export it as CSV"
        raise invalid(str(path), message) from error
    return ["\t".join(row).rstrip("\t") for row in sheet.fillna("").astype(str).to_numpy()]


def _holds_fields(line: str) -> bool:
    return bool(line.strip(" \t;,|")) and not line.lstrip().startswith("#")


def _fields(line: str, separator: str) -> list[str]:
    """Stripped fields of a line; quoted ones may contain the separator."""
    if separator == " ":
        return line.split()
    fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [field.strip().replace("\u2212", "-") for field in fields]


def _number(field: str, comma: bool) -> str:
    """A number with a decimal point, and no marks between thousands; empty if it is none."""
    pointed = field.translate(EXCHANGED) if comma else field
    return pointed.replace(",", "") if NUMBER.fullmatch(pointed) else ""


def _dialect(lines: Sequence[str], separators: str) -> tuple[str, bool]:
    """The separator and whether numbers have a decimal comma: what explains most lines."""
    sample = [line for line in lines if _holds_fields(line)][-SEEN:]

    def explained(choice: tuple[str, bool]) -> tuple[float, bool, int]:
        separator, comma = choice
        rows = [_fields(line, separator) for line in sample]
        numbers = [[bool(_number(field, comma)) for field in row] for row in rows]
        shares = [sum(row) / len(row) for row in numbers if len(row) > 1]
        share = sum(each for each in shares if each >= 0.5)
        marked = comma and any("," in field for row in rows for field in row)
        weight = OF_SPACES if separator == " " else 1.0
        return share * weight, marked or not comma, -SEPARATORS.find(separator)

    return max(product(separators, (True, False)), key=explained)


def _first_of_table(rows: Sequence[_Row]) -> int | None:
    """Index of the first row of the longest table: rows of one length that begin with a number."""
    first: int | None = None
    start, length, longest = 0, 0, 0
    for index, row in enumerate(rows):
        before = rows[index - 1]
        # A row without a number ends a table only below a gap, to notice incomplete ones.
        follows = row.numeric or row.line == before.line + 1
        if length and len(row.fields) == len(before.fields) and follows:
            length += 1
        else:
            start, length = index, int(row.numeric)
        if length > longest:
            longest, first = length, start
    return first


def _headers(
    rows: Sequence[_Row], first: int, lines: Sequence[str], separator: str
) -> list[str] | None:
    """The headers above a table, each with its unit if a row of units follows them."""
    line, fields, _ = rows[first]
    nearest = next((each for each in reversed(lines[: line - 1]) if each.strip()), "")
    if nearest.lstrip().startswith("#"):
        commented = _fields(nearest.lstrip("# \t"), separator)
        if len(commented) == len(fields):
            return commented

    def is_header(row: _Row) -> bool:
        return not row.numeric and abs(len(row.fields) - len(fields)) <= 1

    above = list(takewhile(is_header, rows[max(first - 2, 0) : first][::-1]))
    if not above:
        return None
    header = above[0].fields
    given = [field for field in header if field]
    units = given and all(IN_BRACKETS.fullmatch(field) or _is_unit(field) for field in given)
    if len(above) > 1 and above[1].line == above[0].line - 1 and units:
        names = above[1].fields
        header = [
            f"{name} [{unit}]" if unit and not IN_BRACKETS.fullmatch(unit) else f"{name} {unit}"
            for name, unit in zip_longest(names, header[: len(names)], fillvalue="")
        ]
    header = [name.strip() for name in header]
    while header and not header[-1]:
        header.pop()
    return header


def _is_unit(text: str) -> bool:
    try:
        pint.get_application_registry().parse_units(text)
    except Exception:  # pint raises many types for a text that is not a unit
        return False
    return True
