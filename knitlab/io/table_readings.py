"""The readings of a file of tables: by separator, by decimal mark, and the tables that each finds.

Readings are compared by the numbers in the tables that have the requested columns. Headers and
remarks do not count. If two readings with different numbers remain, the error shows both.
"""

import csv
import re
from collections.abc import Callable, Iterable, Sequence
from itertools import product, takewhile, zip_longest
from math import isnan, nan
from typing import Literal, NamedTuple

import numpy as np

from knitlab.io.errors import invalid, shown

SEPARATORS = ",;\t| "  # of columns; any number of spaces is one separator
BETWEEN = " \t;,|"  # characters of a line without fields
NUMBERS = {
    mark == ",": re.compile(
        rf"[+-]?([1-9]\d{{0,2}}({thousands}\d{{3}})+({mark}\d*)?"
        rf"|(\d+({mark}\d*)?|{mark}\d+)(e[+-]?\d+)?)",
        re.IGNORECASE,
    )
    for mark, thousands in ((r"\.", ","), (",", r"\."))
}
"""Numbers, perhaps with marks between thousands, by whether the decimal mark is a comma."""
IN_BRACKETS = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
SAMPLED = 400  # lines that decide which separators and marks are tried
PLAUSIBLE = 0.5  # score of these, over the best
LAST_ROWS = 9  # of a table, whose steps tell whether the next row continues it
CONTINUED = 2.0  # largest step to a row that continues a table, over these steps
THOUSAND = 1000.0  # from which numbers may have marks between thousands
WITH_POINT = " with a decimal point"  # beside decimal commas, so that it is no number to pandas

Decimal = Literal[".", ","]
Fits = Callable[[list[str]], bool]  # whether a header has the requested columns
Cell = str | float  # of a workbook; those of text are strings
Line = tuple[int, list[Cell]]  # the number of a line, from 1, and its fields
Sheets = dict[str, list[Line]]  # of a workbook by name; a text is one without a name
Way = tuple[Sheets, bool]  # to read a file: its fields, and whether the decimal mark is a comma


class Choice(NamedTuple):
    """What the user says of a file that can be read in several ways."""

    decimal: Decimal | None = None  # mark of its numbers
    table: int | None = None  # which of its tables with the requested columns, from 1

    @property
    def commas(self) -> list[bool]:
        """Whether the decimal mark is a comma, in the readings to try; InputError if neither."""
        if self.decimal not in (None, ".", ","):
            raise invalid("decimal", f"is {shown(self.decimal)}; give '.' or ','")
        return [False, True] if self.decimal is None else [self.decimal == ","]


class Row(NamedTuple):
    """Fields of a line; its numbers have a decimal point, and no marks between thousands."""

    line: int
    fields: list[str]
    values: list[float]  # NaN for a field that is no number
    texts: int  # fields that are neither numbers nor empty
    is_numeric: bool  # whether any is a number with one of the decimal marks
    has_label: bool  # whether the first is a text

    @property
    def numbers(self) -> list[float]:
        """The values of its numbers."""
        return [value for value in self.values if not isnan(value)]


class Block(NamedTuple):
    """A table in a file: the header, and the rows directly below."""

    headers: list[str] | None
    rows: list[Row]
    above: list[Row]  # rows of text directly above, all as long as the last
    line: int  # at which it begins
    sheet: str = ""

    @property
    def place(self) -> str:
        """Where it begins."""
        return f"line {self.line}" + (f" of sheet {self.sheet}" if self.sheet else "")

    @property
    def is_table(self) -> bool:
        """Whether it has a header, and more numbers than texts, unlike a list of properties."""
        surplus = sum(len(row.numbers) - row.texts for row in self.rows)
        return self.headers is not None and surplus > 0

    @property
    def full_rows(self) -> list[Row]:
        """The rows that are as long as the header."""
        return list(filter(self.has_length_of, self.rows))

    def has_length_of(self, row: Row) -> bool:
        """Whether a row is as long as the header, but for empty fields at its end."""
        width = len(self.headers or self.rows[0].fields)
        return len(row.fields) >= width and not any(row.fields[width:])


class Reading(NamedTuple):
    """One way to read a file."""

    comma: bool  # whether the decimal mark is a comma
    blocks: list[Block]
    fits: bool  # whether a header has the requested columns
    tables: list[Block]  # those with such a header, or else the longest

    @property
    def rank(self) -> tuple[bool, float]:
        """Whether a header fits, and the numbers in its tables, in rows with texts less."""
        return self.fits, round(sum(_score(table.full_rows) for table in self.tables), 6)


def numeric_reading(where: str, ways: list[Way], is_offered: bool, fits: Fits) -> Reading:
    """The reading that the numbers support; InputError shows two that they both support."""
    readings = [_reading(*way, fits) for way in ways]
    best = max(reading.rank for reading in readings)
    taken, *others = [reading for reading in readings if reading.rank == best]
    for other in others:
        taken = _supported(where, taken, other, is_offered)
    return taken


def _reading(sheets: Sheets, comma: bool, fits: Fits) -> Reading:
    blocks = [
        block._replace(sheet=name)
        for name, lines in sheets.items()
        for block in _blocks(_rows(lines, comma), fits)
    ]
    fitting = [block for block in blocks if block.headers and fits(block.headers)]
    longest = sorted(blocks, key=lambda block: _score(block.full_rows))[-1:]
    return Reading(comma, blocks, bool(fitting), fitting or longest)


def _score(rows: Iterable[Row]) -> float:
    """The number of numbers in rows, less in those with texts."""
    counts = ((len(row.numbers), row.texts) for row in rows)
    return sum(numbers**2 / (numbers + texts) for numbers, texts in counts if numbers)


def _supported(where: str, one: Reading, other: Reading, is_offered: bool) -> Reading:
    """That of two readings with equal scores that marks all thousands, if the other does not."""
    rows = [[row for table in each.tables for row in table.full_rows] for each in (one, other)]
    pairs = list(zip(*rows, strict=False))
    differing = [(row, changed) for row, changed in pairs if row.numbers != changed.numbers]
    if not differing:
        return one
    sizes = [
        (abs(value), abs(changed))
        for row, changed_row in pairs
        for value, changed in zip(row.values, changed_row.values, strict=False)
    ]
    if any(size == changed >= THOUSAND for size, changed in sizes):  # without a mark
        marked = any(size > changed for size, changed in sizes)
        if marked != any(changed > size for size, changed in sizes):
            return other if marked else one
    row, changed_row = differing[0]
    point, comma = (changed_row, row) if one.comma else (row, changed_row)
    message = f"line {row.line} is {', '.join(point.fields[:4])} with decimal points and"
    message += f" {', '.join(comma.fields[:4])} with decimal commas; "
    hint = "give decimal = '.' or ','" if is_offered else "write it as 1.0, without marks"
    raise invalid(where, message + hint)


def text_ways(lines: list[str], commas: list[bool]) -> list[Way]:
    """The plausible ways to read a text: not far worse than the best in its last lines."""
    separators = SEPARATORS
    # Excel states the separator in a first line such as ``sep=;``.
    if stated := re.fullmatch(r'"?sep=(.)"?', lines[0].strip()):
        lines[0], separators = "", stated[1]
    sample = [line for line in lines if line.strip(BETWEEN)][-SAMPLED:]
    # Where columns are separated by commas, a decimal comma is in quotes.
    is_quoted = any('"' in line for line in lines)
    scores = {
        (separator, comma): _score(
            row for row in _rows(_text_lines(sample, separator), comma) if row.fields[1:]
        )
        for separator, comma in product(separators, commas)
        if is_quoted or stated or (separator, comma) != (",", True)
    }
    least = PLAUSIBLE * max(scores.values(), default=0.0)
    return [
        ({"": _text_lines(lines, separator)}, comma)
        for (separator, comma), score in scores.items()
        if score >= least
    ]


def _text_lines(lines: Sequence[str], separator: str) -> list[Line]:
    """The lines that hold fields.

    Lines that start with # are left out, except one directly above a line with as many fields,
    which may be a header.
    """
    made: list[Line] = []
    header: list[Cell] = []
    for number, line in enumerate(lines, 1):
        if not line.strip(BETWEEN):
            continue
        if line.lstrip().startswith("#"):
            header = _line_fields(line.lstrip("# \t"), separator)
            continue
        fields = _line_fields(line, separator)
        if len(header) == len(fields) and not any(map(_number, header)):
            made.append((number - 1, header))
        header = []
        made.append((number, fields))
    return made


def _line_fields(line: str, separator: str) -> list[Cell]:
    """Stripped fields of a line of text; quoted ones may contain the separator."""
    if separator == " ":
        return list(line.split())
    fields = line.split(separator)
    if '"' in line:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [field.strip().replace("\u2212", "-") for field in fields]


def _rows(lines: Sequence[Line], comma: bool) -> list[Row]:
    rows = []
    for line, cells in lines:
        numbers = [_number(cell, comma) for cell in cells]
        # That remarks do not decide on the mark, tables have the same lines with each.
        others = [
            "" if number else _number(cell, not comma)
            for number, cell in zip(numbers, cells, strict=True)
        ]
        fields = [
            number or f"{cell}{WITH_POINT if comma and other else ''}"
            for number, other, cell in zip(numbers, others, cells, strict=True)
        ]
        values = [float(number) if number else nan for number in numbers]
        count = sum(map(bool, fields)) - sum(map(bool, numbers))
        has_label = bool(fields[0] and not (numbers[0] or others[0]))
        is_numeric = any(numbers) or any(others)
        rows.append(Row(line, fields, values, count, is_numeric, has_label))
    return rows


def _number(cell: Cell, comma: bool = False) -> str:
    """A number with a decimal point, and no marks between thousands; empty if it is none."""
    if not isinstance(cell, str):
        return repr(cell)
    if cell.isdecimal():
        return cell
    if not NUMBERS[comma].fullmatch(cell):
        return ""
    return cell.replace(".", "").replace(",", ".") if comma else cell.replace(",", "")


def _blocks(rows: Sequence[Row], fits: Fits) -> list[Block]:
    """The tables of a sheet in their order, and rows with a label, such as ``Maximum;4``."""
    blocks: list[Block] = []
    texts: list[Row] = []  # rows without numbers, or with a label, since the last other one
    for row in rows:
        last = blocks[-1] if blocks else None
        # A row with a label, where the table has numbers, is as ``Specimen;2``.
        numbers = last and last.headers and not last.rows[-1].has_label
        if not row.is_numeric or (numbers and row.has_label):
            texts.append(row)
            continue
        if last and last.has_length_of(row) and _continues(last, texts, row, fits):
            last.rows.extend([*_entries(last, texts, fits), row])
        elif (
            last
            and last.headers
            and row.line == last.rows[-1].line + 1
            and last.has_length_of(last.rows[-1])
        ):
            last.rows.append(row)  # of another length, which is an error if the table is read
        else:
            blocks.append(_begun(row, texts, blocks, fits))
        texts = []
    if blocks:
        blocks[-1].rows.extend(_entries(blocks[-1], texts, fits))
    read = {row.line for block in blocks for row in block.rows}
    labelled = (row for row in rows if row.is_numeric and row.line not in read)
    blocks += [Block(None, [row], [], row.line) for row in labelled]
    return sorted(blocks, key=lambda block: block.line)


def _entries(block: Block, texts: list[Row], fits: Fits) -> list[Row]:
    """The rows of text, if they are entries of a table that directly follow, such as ``nan``."""
    follows = block.headers and all(
        text.line == line and block.has_length_of(text) and not fits(text.fields)
        for line, text in enumerate(texts, block.rows[-1].line + 1)
    )
    return texts if follows else []


def _continues(block: Block, texts: list[Row], row: Row, fits: Fits) -> bool:
    """Whether a row continues a table: directly, or below a gap or a remark by its numbers."""
    if row.line == block.rows[-1].line + 1:
        return True
    last = [each.numbers[0] for each in block.rows[-LAST_ROWS:] if each.numbers]
    if not (row.numbers and last):
        return False
    first, reach = row.numbers[0], CONTINUED * float(np.abs(np.diff(last)).max(initial=0.0))
    if texts and not _entries(block, texts, fits):
        new = last[-1] < first <= last[-1] + reach
        return new and block.headers is not None and fits(block.headers)
    return first >= last[-1] - reach


def _begun(row: Row, texts: list[Row], blocks: list[Block], fits: Fits) -> Block:
    """A table that begins with a row, below rows of text; its header may be that of another."""
    width = len(row.fields)
    near = list(takewhile(lambda text: abs(len(text.fields) - width) <= 1, texts[-2:][::-1]))
    # The names of columns may also be those of units.
    possible = [_headers(near), near[0].fields] if near else []
    headers = next(filter(fits, possible), None)
    if headers is None:
        for before in reversed(blocks):
            known = before.headers if before.has_length_of(row) else None
            if known and (not near or fits(known)):
                return before._replace(rows=[row], line=texts[0].line if texts else row.line)
        headers = possible[0] if possible else None
    above = takewhile(lambda text: len(text.fields) == len(texts[-1].fields), texts[::-1])
    return Block(headers, [row], list(above)[::-1], near[-1].line if near else row.line)


def _headers(above: list[Row]) -> list[str]:
    """The headers in the nearest rows of text, each with its unit if a row of units follows."""
    header = above[0].fields
    given = [field for field in header if field]
    units = given and all(IN_BRACKETS.fullmatch(field) or is_unit(field) for field in given)
    if len(above) > 1 and above[1].line == above[0].line - 1 and units:
        header = [
            f"{name} [{unit}]" if unit and not IN_BRACKETS.fullmatch(unit) else f"{name} {unit}"
            for name, unit in zip_longest(
                above[1].fields, header[: len(above[1].fields)], fillvalue=""
            )
        ]
    header = [name.strip() for name in header]
    while header and not header[-1]:
        header.pop()
    return header


def is_unit(text: str) -> bool:
    """Whether a text is a unit."""
    try:
        import pint  # slow to import

        pint.get_application_registry().parse_units(text)
    except Exception:  # pint raises many types for a text that is not a unit
        return False
    return True
