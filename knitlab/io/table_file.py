"""Tables of numbers in text, as machines and programs write them, and the units of their columns.

Separator, decimal mark, header and a row of units are recognised; blocks of properties above the
header are left out. What is ambiguous or torn is an error that names the line.
"""

import csv
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import product, zip_longest
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
import pandas as pd
import pint
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.text_file import read_text

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}
"""Separators of columns; any number of spaces is one separator."""
_EXPONENT = r"(e[+-]?\d+)?"
POINT = re.compile(r"[+-]?((\d{1,3}(,\d{3})+|\d+)(\.\d*)?|\.\d+)" + _EXPONENT, re.IGNORECASE)
COMMA = re.compile(r"[+-]?((\d{1,3}(\.\d{3})+|\d+)(,\d*)?|,\d+)" + _EXPONENT, re.IGNORECASE)
"""Numbers with a decimal point or comma, and with the other mark between thousands."""
IN_BRACKETS = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
WORKBOOKS = (".xlsx", ".xlsm")
SEEN = 400
"""Lines that decide on separator and decimal mark."""

Row = tuple[int, list[str]]
"""Number of a line, from 1, and its fields."""


class Table(NamedTuple):
    """A table of text: its headers, which may contain duplicates, and its rows.

    ``above`` are all rows of texts of its width directly above it, if there are several.
    """

    headers: list[str]
    rows: pd.DataFrame
    above: list[list[str]]


def read_table(path: Path, example: str) -> Table:
    """Read a table of numbers; its entries remain text.

    A row of units is joined to the header: ``Load`` above ``(N)`` is ``Load (N)``, and above ``N``
    it is ``Load [N]``. Numbers have a decimal point. The first sheet of a workbook (``.xlsx``) is
    read where openpyxl is installed.

    Args:
        path: the file; lines that start with # are ignored, except a header in the last of them.
        example: an example of such a table, for the message.

    Raises:
        BadInput: if it cannot be read, or is no table; the message names the line.
    """
    if path.suffix.lower() in WORKBOOKS and path.is_file():
        lines, split, comma = _workbook_lines(path), _fields_of("\t"), False
    else:
        lines = read_text(path).split("\n")
        separator, lines = _stated_separator(lines)
        separator, comma = _dialect(lines, [separator] if separator else list(SEPARATORS))
        split = _fields_of(separator)
    rows = [(number, split(line)) for number, line in enumerate(lines, 1) if _holds_fields(line)]
    first = _first_of_table(rows, comma)
    if first is None:
        raise fault(str(path), f"has no table of numbers; {example}")
    headers = _headers(rows, first, lines, split, comma)
    if headers is None:
        number, fields = rows[first]
        before, torn = rows[first - 1]
        if before == number - 1:
            problem = f"has {len(torn)} fields, and the next line {len(fields)}; correct the line"
            if len(fields) == 2 * len(torn):
                problem += ", or if the decimal mark is a comma, separate columns by semicolons"
            raise fault(f"{path}: line {before}", problem)
        problem = f"has no header above line {number} ({', '.join(fields[:4])}); {example}"
        raise fault(str(path), problem)
    body = rows[first:]
    width = len(headers)
    for number, fields in body:
        if (len(fields) != width and any(fields[width:])) or len(fields) < width:
            named = ", ".join(headers[:6])
            problem = f"has {len(fields)} fields and the header {width} ({named}); correct the line"
            raise fault(f"{path}: line {number}", problem)
    plain = [[_plain(field, comma) for field in fields[:width]] for _, fields in body]
    above: list[list[str]] = []
    for _, fields in reversed(rows[:first]):
        if len(fields) != width or any(_is_number(field, comma) for field in fields):
            break
        above.insert(0, fields)
    return Table(headers, pd.DataFrame(plain), above)


def numbers_of(
    path: Path, name: str, column: pd.Series
) -> tuple[Float[np.ndarray, " point"], list[Fault]]:
    """The numbers of a column, and faults of the entries that are not numbers."""
    values = pd.to_numeric(column, errors="coerce").to_numpy(float)
    bad = np.flatnonzero(~np.isfinite(values))
    faults = []
    if len(bad):
        first = column.iloc[bad[0]]
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        value = repr(first) if first else "empty"
        problem = f"point {bad[0] + 1} is {value}{more}, not a finite number; correct or remove it"
        faults.append(Fault(f"{path}: column {name}", problem))
    return values, faults


def read_columns(
    path: Path,
    names: Mapping[str, str | None],
    example: str,
    *,
    lower: bool = False,
    if_present: Collection[str] = (),
) -> dict[str, Float[np.ndarray, " point"]]:
    """Numbers of columns by name, whether or not the header adds a unit in brackets.

    Args:
        path: the file.
        names: names of the columns, each with its unit or ``None``.
        example: an example of such a table, for messages.
        lower: whether headers are taken in lower case.
        if_present: names of further columns, in lower case, that are read where they are numbers.

    Raises:
        BadInput: with every missing, repeated or wrong column; or if the unit of a header is not
            that of ``names``.
    """
    headers, rows, _ = read_table(path, example)
    present = [header.lower() if lower else header for header in headers]
    bare = [without_unit(header) for header in present]
    columns, faults = {}, list[Fault]()
    for name, unit in names.items():
        where = f"{path}: column {name}"
        known, wanted = (present, name) if name in present else (bare, without_unit(name))
        if known.count(wanted) != 1:
            problem = f"is missing; the file has {', '.join(headers)}; {example}"
            problem = "occurs twice; keep one" if wanted in known else problem
            faults.append(Fault(where, problem))
            continue
        column = known.index(wanted)
        faults += _unit_faults(where, headers[column], unit)
        columns[name], wrong = numbers_of(path, name, rows[column])
        faults += wrong
    for number, header in enumerate(headers):
        if header.lower() in if_present:
            numbers, wrong = numbers_of(path, header, rows[number])
            columns |= {} if wrong else {header.lower(): numbers}
    if faults:
        raise BadInput(faults)
    return columns


def without_unit(header: str) -> str:
    """A header without the unit in brackets that ends it."""
    return IN_BRACKETS.sub("", header).strip() if header.endswith((")", "]")) else header


def _unit_faults(where: str, header: str, unit: str | None) -> list[Fault]:
    """A fault if a header names another unit than the one stated for it."""
    in_header = IN_BRACKETS.findall(header)
    given = in_header[-1] if in_header else ""
    if unit is None or not given or not _is_unit(given[1:-1]):
        return []
    factor, faults = factor_of(where, given[1:-1], unit, f"such as {unit}")
    if not faults and np.isclose(factor, 1):
        return []
    return [Fault(where, f"is in {given} by its header, but {unit} is stated; correct one")]


def factor_of(where: str, unit: str, target: str, remedy: str) -> tuple[float, list[Fault]]:
    """Factor from one unit to another, and faults of the first; ``remedy`` names accepted units."""
    try:
        once, twice = (_in_unit(value, unit, target) for value in (1.0, 2.0))
        if not np.isclose(twice, 2 * once):  # a logarithmic unit
            raise pint.DimensionalityError(unit, target)
        return once, []
    except pint.DimensionalityError:
        return np.nan, [Fault(where, f"is in {unit}; give it in a unit {remedy}")]
    except Exception:  # pint raises many types for a text that is not a unit
        return np.nan, [Fault(where, f"has the unknown unit {unit!r}; give one {remedy}")]


def _in_unit(value: float, unit: str, target: str) -> float:
    registry = pint.get_application_registry()
    quantity = registry.Quantity(value, "dimensionless" if unit == "1" else unit)
    if target == "1" and not quantity.to_root_units().unitless:  # an angle
        raise pint.DimensionalityError(unit, target)
    return float(quantity.to("dimensionless" if target == "1" else target).magnitude)


def _workbook_lines(path: Path) -> list[str]:
    """The first sheet of a workbook as lines whose fields are separated by tabs."""
    try:
        sheet = pd.read_excel(path, header=None, dtype=str, keep_default_na=False)
    except ImportError as error:
        problem = "is an Excel workbook; export it as CSV, or install openpyxl"
        raise fault(str(path), problem) from error
    except (ValueError, KeyError, OSError, BadZipFile) as error:
        problem = "is an Excel workbook that cannot be read; open it, and export it as CSV"
        raise fault(str(path), problem) from error
    return ["\t".join(row).rstrip("\t") for row in sheet.fillna("").astype(str).to_numpy()]


def _stated_separator(lines: list[str]) -> tuple[str | None, list[str]]:
    """The separator that Excel states in a first line such as ``sep=;``, which is then blanked."""
    stated = re.fullmatch(r'"?sep=(.)"?', lines[0].strip()) if lines else None
    return (stated[1], ["", *lines[1:]]) if stated else (None, lines)


def _fields_of(separator: str) -> Callable[[str], list[str]]:
    """What splits a line into stripped fields; quoted fields may contain the separator."""

    def split(line: str) -> list[str]:
        if separator == " ":
            return line.split()
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        return [field.strip().replace("\u2212", "-") for field in fields]

    return split


def _holds_fields(line: str) -> bool:
    return bool(line.strip(" \t;,|")) and not line.lstrip().startswith("#")


def _is_number(field: str, comma: bool) -> bool:
    return bool((COMMA if comma else POINT).fullmatch(field))


def _plain(field: str, comma: bool) -> str:
    """A field whose number has a decimal point, and no marks between thousands."""
    if not _is_number(field, comma):
        return field
    return field.replace(".", "").replace(",", ".") if comma else field.replace(",", "")


def _dialect(lines: Sequence[str], separators: Sequence[str]) -> tuple[str, bool]:
    """The separator and whether numbers have a decimal comma: what explains most of the text.

    Counted are the lines of several fields of which most are numbers. A decimal comma is believed
    only if a number has one.
    """
    sample = [line for line in lines if _holds_fields(line)][-SEEN:]

    def explained(choice: tuple[str, bool]) -> tuple[float, bool, int]:
        separator, comma = choice
        split = _fields_of(separator)
        rows = [split(line) for line in sample]
        numbers = [[_is_number(field, comma) for field in row] for row in rows]
        good = [row for row in numbers if len(row) > 1 and sum(row) > 0.5 * len(row) - 1e-9]
        share = sum(sum(row) / len(row) for row in good)
        marked = comma and any("," in field for row in rows for field in row)
        return share, marked or not comma, -list(SEPARATORS).index(separator)

    best = max(product(separators, (True, False)), key=explained)
    if best[0] == " ":
        # Spaces within texts look like separators, so that these must explain much more.
        marks = [each for each in separators if each != " "]
        other = max(product(marks, (True, False)), key=explained, default=best)
        return other if explained(best)[0] < 1.5 * explained(other)[0] else best
    return best


def _first_of_table(rows: Sequence[Row], comma: bool) -> int | None:
    """Index of the first row of the longest table: rows of one length that begin with a number.

    A row without a number ends a table only below a gap, so that a torn row is noticed.
    """
    first: int | None = None
    start, length, longest = 0, 0, 0
    for index, (number, fields) in enumerate(rows):
        numeric = any(_is_number(field, comma) for field in fields)
        before, fields_before = rows[index - 1]
        if length and len(fields) == len(fields_before) and (numeric or number == before + 1):
            length += 1
        else:
            start, length = index, int(numeric)
        if length > longest:
            longest, first = length, start
    return first


def _headers(
    rows: Sequence[Row],
    first: int,
    lines: Sequence[str],
    split: Callable[[str], list[str]],
    comma: bool,
) -> list[str] | None:
    """The headers above a table, each with its unit if a row of units follows them."""
    number, fields = rows[first]
    nearest = next((line for line in reversed(lines[: number - 1]) if line.strip()), "")
    if nearest.lstrip().startswith("#"):
        commented = split(nearest.lstrip("# \t"))
        if len(commented) == len(fields):
            return commented
    above: list[list[str]] = []
    for line, row in reversed(rows[max(first - 2, 0) : first]):
        if any(_is_number(field, comma) for field in row) or abs(len(row) - len(fields)) > 1:
            break
        if above and line < rows[first - 1][0] - 1:
            break
        above.append(row)
    if not above:
        return None
    if len(above) > 1 and _are_units(above[0]):
        units, names = above
        pairs = zip_longest(names, units[: len(names)], fillvalue="")
        above = [[_with_unit(name, unit) for name, unit in pairs]]
    header = above[0]
    while header and not header[-1]:
        header = header[:-1]
    return header


def _with_unit(name: str, unit: str) -> str:
    bare = unit and not IN_BRACKETS.fullmatch(unit)
    return f"{name} [{unit}]" if bare else f"{name} {unit}".strip()


def _are_units(fields: Sequence[str]) -> bool:
    given = [field for field in fields if field]
    return bool(given) and all(IN_BRACKETS.fullmatch(field) or _is_unit(field) for field in given)


def _is_unit(text: str) -> bool:
    try:
        pint.get_application_registry().parse_units(text)
    except Exception:  # pint raises many types for a text that is not a unit
        return False
    return True
