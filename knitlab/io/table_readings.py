"""The readings of a file of tables: by separator, by decimal mark, and the tables that each finds.

Readings are compared by the numbers in the tables that have the requested columns. Headers and
remarks do not count. If two readings with different numbers remain, the error shows both.
"""

import csv
import re
from collections.abc import Callable, Sequence
from itertools import product, takewhile, zip_longest
from typing import Literal, NamedTuple

import numpy as np
import pint
from jaxtyping import Float

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
NUMBER = NUMBERS[False]
IN_BRACKETS = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
SAMPLED = 400  # lines that decide which separators and marks are tried
PLAUSIBLE = 0.5  # score of these, over the best
LAST_ROWS = 9  # of a table, whose steps tell whether the next row continues it
CONTINUED = 2.0  # largest step to a row that continues a table, over these steps
THOUSAND = 1000.0  # from which numbers may have marks between thousands
SMOOTHER = 0.5  # roughness of columns in the reading that is taken, over that of the other

Decimal = Literal[".", ","]
Fits = Callable[[list[str]], bool]  # whether a header has the requested columns
Cell = str | float  # of a workbook; those of text are strings
Line = tuple[int, list[Cell]]  # the number of a line, from 1, and its fields
Values = Float[np.ndarray, "row column"]
Source = list[str] | dict[str, list[Line]]  # lines of text, or the sheets of a workbook by name


class Choice(NamedTuple):
    """What the user says of a file that can be read in several ways."""

    decimal: Decimal | None = None  # mark of its numbers
    table: int | None = None  # which of its tables with the requested columns, from 1
    is_offered: bool = True  # whether the user can state these


UNSTATED = Choice(is_offered=False)


class Row(NamedTuple):
    """Fields of a line; its numbers have a decimal point, and no marks between thousands."""

    line: int
    fields: list[str]
    numbers: int
    texts: int  # fields that are neither numbers nor empty
    numeric: bool  # whether any is a number with one of the decimal marks


class Block(NamedTuple):
    """A table in a file: rows of one length, and the header above them."""

    headers: list[str] | None
    rows: list[Row]
    above: list[Row]  # rows of text directly above
    line: int  # at which it begins
    sheet: str = ""
    broken: Row | None = None  # the first row of another length

    @property
    def place(self) -> str:
        """Where it begins."""
        return f"line {self.line}" + (f" of sheet {self.sheet}" if self.sheet else "")

    @property
    def is_table(self) -> bool:
        """Whether it has a header, and more numbers than texts, unlike a list of properties."""
        surplus = sum(row.numbers - row.texts for row in self.rows)
        return self.headers is not None and surplus > 0

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
    def score(self) -> float:
        """The number of numbers in its tables, in rows with texts less."""
        return sum(_score(row) for table in self.tables for row in table.rows)


def numeric_reading(
    where: str, source: Source, separators: str, choice: Choice, fits: Fits
) -> Reading:
    """The reading that the numbers support; InputError shows two that they both support."""
    decimal = choice.decimal
    if decimal not in (None, ".", ","):
        raise invalid("decimal", f"is {shown(decimal)}; give '.' or ','")
    marks = [False, True] if decimal is None else [decimal == ","]
    if isinstance(source, list):
        pairs = _plausible(source, list(product(separators, marks)))
        readings = [
            _reading({"": text_lines(source, separator)}, comma, fits) for separator, comma in pairs
        ]
    else:
        readings = [_reading(source, comma, fits) for comma in marks]

    def rank(reading: Reading) -> tuple[bool, float]:
        return reading.fits, round(reading.score, 6)

    best = max(map(rank, readings))
    taken, *others = [reading for reading in readings if rank(reading) == best]
    for other in others:
        taken = _supported(where, taken, other, choice)
    return taken


def _plausible(lines: list[str], pairs: list[tuple[str, bool]]) -> list[tuple[str, bool]]:
    """Separators and decimal marks that are not far worse than the best in the last lines."""
    sample = [line for line in lines if line.strip(BETWEEN)][-SAMPLED:]
    # Where columns are separated by commas, a decimal comma is in quotes.
    pairs = [pair for pair in pairs if pair != (",", True) or any('"' in line for line in lines)]
    scores = [
        sum(_score(row) for row in _rows(text_lines(sample, separator), comma) if row.fields[1:])
        for separator, comma in pairs
    ]
    least = PLAUSIBLE * max(scores)
    return [pair for pair, score in zip(pairs, scores, strict=True) if score >= least]


def _reading(sheets: dict[str, list[Line]], comma: bool, fits: Fits) -> Reading:
    blocks = [
        block._replace(sheet=name)
        for name, lines in sheets.items()
        for block in _blocks(_rows(lines, comma), fits)
    ]
    fitting = [block for block in blocks if block.headers and fits(block.headers)]
    longest = sorted(blocks, key=lambda block: sum(map(_score, block.rows)))[-1:]
    return Reading(comma, blocks, bool(fitting), fitting or longest)


def _score(row: Row) -> float:
    return row.numbers**2 / (row.numbers + row.texts) if row.numbers else 0.0


def _supported(where: str, one: Reading, other: Reading, choice: Choice) -> Reading:
    """That of two readings with equal scores whose numbers agree better with each other."""
    rows = [[row for table in each.tables for row in table.rows] for each in (one, other)]
    pairs = list(zip(*rows, strict=False))
    differing = [pair for pair in pairs if _numbers(pair[0]) != _numbers(pair[1])]
    if not differing:
        return one
    width = max(len(row.fields) for row in rows[0])
    values = np.array([[_values(row, width) for row in pair] for pair in pairs]).swapaxes(0, 1)
    partly, rough = _doubts(*values)
    other_partly, other_rough = _doubts(*values[::-1])
    if partly != other_partly:
        return other if partly else one
    if min(rough, other_rough) < SMOOTHER * max(rough, other_rough):
        return other if other_rough < rough else one
    row, changed_row = differing[0]
    point, comma = (changed_row, row) if one.comma else (row, changed_row)
    message = f"line {row.line} is {', '.join(point.fields[:4])} with decimal points and"
    message += f" {', '.join(comma.fields[:4])} with decimal commas; "
    hint = "give decimal = '.' or ','" if choice.is_offered else "write it as 1.0, without marks"
    raise invalid(where, message + hint)


def _is_number(field: str) -> bool:
    return bool(NUMBER.fullmatch(field))


def _numbers(row: Row) -> list[str]:
    return list(filter(_is_number, row.fields))


def _values(row: Row, width: int) -> list[float]:
    values = [float(field) if _is_number(field) else np.nan for field in row.fields]
    return values[:width] + [np.nan] * (width - len(values))


def _doubts(values: Values, other: Values) -> tuple[bool, float]:
    """Whether a reading marks only some thousands, and its roughness in columns that it bends."""
    unmarked, marked = np.abs(values[values == other]), np.abs(values) > np.abs(other)
    rough, other_rough = (np.array(list(map(_roughness, each.T))) for each in (values, other))
    bent = ~np.isclose(rough, other_rough)
    return bool(marked.any() and (unmarked >= THOUSAND).any()), float(rough[bent].sum())


def _roughness(column: Float[np.ndarray, " row"]) -> float:
    """Sum of the second differences, over the range."""
    known = column[np.isfinite(column)]
    span = np.ptp(known) if len(known) else 0.0
    return float(np.abs(np.diff(known, 2)).sum() / span) if span else 0.0


def text_lines(lines: Sequence[str], separator: str) -> list[Line]:
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
        fields = [number or str(cell) for number, cell in zip(numbers, cells, strict=True)]
        count = sum(map(bool, numbers))
        # That remarks do not decide on the mark, tables have the same lines with each.
        numeric = count > 0 or any(_number(cell, not comma) for cell in cells)
        rows.append(Row(line, fields, count, sum(map(bool, fields)) - count, numeric))
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
    """The tables of a sheet in their order."""
    blocks: list[Block] = []
    texts: list[Row] = []  # rows without numbers, or with a label, since the last other one
    for row in rows:
        block = blocks[-1] if blocks else None
        if not row.numeric or (block is not None and _is_labelled(row, block)):
            texts.append(row)
            continue
        entries = [] if block is None else _entries(block, texts, fits)
        if block is None:
            blocks.append(_begun(row, texts, blocks, fits))
        elif block.has_length_of(row):
            if _continues(block, texts, entries, row, fits):
                block.rows.extend([*entries, row])
            else:
                blocks.append(_begun(row, texts, blocks, fits))
        elif block.headers and row.line == block.rows[-1].line + 1:
            blocks[-1] = block._replace(broken=block.broken or row)
        else:
            blocks.append(_begun(row, texts, blocks, fits))
        texts = []
    if blocks:
        blocks[-1].rows.extend(_entries(blocks[-1], texts, fits))
    return blocks


def _is_labelled(row: Row, block: Block) -> bool:
    """Whether a row begins with a text where the table has numbers, as in ``Specimen;2``."""
    first = row.fields[0]
    numbers = bool(block.headers) and _is_number(block.rows[-1].fields[0])
    return numbers and bool(first) and not _is_number(first)


def _entries(block: Block, texts: list[Row], fits: Fits) -> list[Row]:
    """The rows of text, if they are entries of a table that directly follow, such as ``nan``."""
    headers, last = block.headers, block.rows[-1]
    if headers and all(
        text.line == line
        and block.has_length_of(text)
        and not fits(text.fields)
        and not all(map(str.startswith, headers, text.fields))
        for line, text in enumerate(texts, last.line + 1)
    ):
        return texts
    return []


def _continues(block: Block, texts: list[Row], entries: list[Row], row: Row, fits: Fits) -> bool:
    """Whether a row continues a table: directly, or below a gap or a remark by its numbers."""
    rows = block.rows
    if row.line == rows[-1].line + 1:
        return True
    last = [number for number in map(_first_number, rows[-LAST_ROWS:]) if number is not None]
    number = _first_number(row)
    if number is None or not last:
        return False
    reach = CONTINUED * float(np.abs(np.diff(last)).max(initial=0.0))
    if texts and not entries:
        new = last[-1] < number <= last[-1] + reach
        return new and block.headers is not None and fits(block.headers)
    return number >= last[-1] - reach


def _first_number(row: Row) -> float | None:
    return next((float(field) for field in row.fields if _is_number(field)), None)


def _begun(row: Row, texts: list[Row], blocks: list[Block], fits: Fits) -> Block:
    """A table that begins with a row, below rows of text; its header may be that of another."""
    width = len(row.fields)
    near = list(takewhile(lambda text: abs(len(text.fields) - width) <= 1, texts[-2:][::-1]))
    headers = _headers(near)
    own = headers is not None and fits(headers)
    if near and not own and fits(near[0].fields):  # as names may be those of units, too
        headers, own = near[0].fields, True
    line = texts[0].line if texts else row.line
    for before in [] if own else reversed(blocks):
        inherited = before.headers if before.has_length_of(row) else None
        if inherited and (headers is None or fits(inherited)):
            return before._replace(rows=[row], line=line, broken=None)
    above = texts[-1:]
    if headers is not None:
        wide = takewhile(lambda text: len(text.fields) == len(headers), texts[::-1])
        above = list(wide)[::-1]
    return Block(headers, [row], above, near[-1].line if near else row.line)


def _headers(above: list[Row]) -> list[str] | None:
    """The headers in the nearest rows of text, each with its unit if a row of units follows."""
    if not above:
        return None
    header = above[0].fields
    given = [field for field in header if field]
    units = given and all(IN_BRACKETS.fullmatch(field) or is_unit(field) for field in given)
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


def is_unit(text: str) -> bool:
    """Whether a text is a unit."""
    try:
        pint.get_application_registry().parse_units(text)
    except Exception:  # pint raises many types for a text that is not a unit
        return False
    return True
