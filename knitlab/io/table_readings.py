"""The readings of a file of tables: by separator, by decimal mark, and the tables that each finds.

Readings are compared by the numbers in the tables that have the requested columns. Headers and
remarks do not count. If two readings with different numbers remain, the error shows both.
"""

import csv
import re
from collections.abc import Callable, Sequence
from itertools import takewhile, zip_longest
from typing import Literal, NamedTuple

import numpy as np
import pint
from jaxtyping import Float

from knitlab.io.errors import invalid

SEPARATORS = ",;\t| "  # of columns; any number of spaces is one separator
NUMBER = re.compile(
    r"[+-]?([1-9]\d{0,2}(,\d{3})+(\.\d*)?|(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?)", re.IGNORECASE
)
"""A number with a decimal point, and perhaps commas between thousands."""
BETWEEN = " \t;,|"  # characters of a line without fields
EXCHANGED = str.maketrans(".,", ",.")
IN_BRACKETS = re.compile(r"\([^()]*\)|\[[^\[\]]*\]")
LAST_ROWS = 9  # of a table, whose steps tell whether the next row continues it
CONTINUED = 2.0  # largest step to a row that continues a table, over these steps
THOUSAND = 1000.0  # from which numbers may have marks between thousands
SMOOTHER = 0.5  # roughness of columns in the reading that is taken, over that of the other

Decimal = Literal[".", ","]
Fits = Callable[[list[str]], bool]  # whether a header has the requested columns
Cell = str | float  # of a workbook; those of text are strings
Line = tuple[int, list[Cell]]  # the number of a line, from 1, and its fields


class Row(NamedTuple):
    """Fields of a line; its numbers have a decimal point, and no marks between thousands."""

    line: int
    fields: list[str]
    numbers: int
    texts: int  # fields that are neither numbers nor empty


class Block(NamedTuple):
    """A table in a file: rows of one length, and the header above them."""

    headers: list[str] | None
    rows: list[Row]
    above: list[Row]  # rows of text directly above
    line: int  # at which it begins
    sheet: str = ""
    broken: Row | None = None  # the first row of another length

    @property
    def is_table(self) -> bool:
        """Whether it has a header, and more numbers than texts, unlike a list of properties."""
        surplus = sum(row.numbers - row.texts for row in self.rows)
        return self.headers is not None and surplus > 0


class Reading(NamedTuple):
    """One way to read a file."""

    comma: bool  # whether the decimal mark is a comma
    blocks: list[Block]
    fits: bool  # whether a header has the requested columns
    tables: list[Block]  # those with such a header, or else the longest

    @property
    def score(self) -> float:
        """The number of numbers in its tables, in rows with texts less."""
        return sum(map(_score, self.tables))


def numeric_reading(
    where: str,
    sheets: dict[str, Callable[[str], list[Line]]],
    separators: str,
    decimal: Decimal | None,
    fits: Fits,
) -> Reading:
    """The reading that the numbers support; InputError shows two that they both support.

    ``sheets`` have, by name, what separates their lines.
    """
    marks = [False, True] if decimal is None else [decimal == ","]
    readings = []
    for separator in separators:
        lines = {name: split(separator) for name, split in sheets.items()}
        marked = separator != "," or any(
            isinstance(cell, str) and "," in cell
            for sheet in lines.values()
            for _, cells in sheet
            for cell in cells
        )
        readings += [_reading(lines, comma, fits) for comma in marks if marked or not comma]

    def rank(reading: Reading) -> tuple[bool, float]:
        return reading.fits, round(reading.score, 6)

    best = max(map(rank, readings))
    taken, *others = [reading for reading in readings if rank(reading) == best]
    for other in others:
        taken = _supported(where, taken, other)
    return taken


def _reading(sheets: dict[str, list[Line]], comma: bool, fits: Fits) -> Reading:
    blocks = [
        block._replace(sheet=name)
        for name, lines in sheets.items()
        for block in _blocks(_rows(lines, comma), fits)
    ]
    fitting = [block for block in blocks if block.headers and fits(block.headers)]
    return Reading(comma, blocks, bool(fitting), fitting or sorted(blocks, key=_score)[-1:])


def _score(block: Block) -> float:
    return sum(row.numbers**2 / (row.numbers + row.texts) for row in block.rows if row.numbers)


def _supported(where: str, one: Reading, other: Reading) -> Reading:
    """That of two readings with equal scores whose numbers agree better with each other."""
    rows = [[row for table in each.tables for row in table.rows] for each in (one, other)]
    pairs = list(zip(*rows, strict=False))
    differing = [pair for pair in pairs if _numbers(pair[0]) != _numbers(pair[1])]
    if not differing:
        return one
    width = max(len(row.fields) for row in rows[0])
    first = np.array([_values(row, width) for row, _ in pairs])
    second = np.array([_values(row, width) for _, row in pairs])
    # Who marks thousands marks them in all numbers.
    large = bool((np.abs(first[first == second]) >= THOUSAND).any())
    refuted = [large and bool((np.abs(first) > np.abs(second)).any())]
    refuted.append(large and bool((np.abs(second) > np.abs(first)).any()))
    if not any(refuted):
        rough, other_rough = _roughness(first), _roughness(second)
        changed = ~np.isclose(rough, other_rough)
        total, other_total = rough[changed].sum(), other_rough[changed].sum()
        refuted = [other_total < SMOOTHER * total, total < SMOOTHER * other_total]
    if refuted[0] != refuted[1]:
        return other if refuted[0] else one
    row, changed_row = differing[0]
    point, comma = (changed_row, row) if one.comma else (row, changed_row)
    message = f"line {row.line} is {', '.join(point.fields[:4])} with decimal points and"
    message += f" {', '.join(comma.fields[:4])} with decimal commas; give decimal = '.' or ','"
    raise invalid(where, message)


def _is_number(field: str) -> bool:
    return bool(NUMBER.fullmatch(field))


def _numbers(row: Row) -> list[str]:
    return list(filter(_is_number, row.fields))


def _values(row: Row, width: int) -> list[float]:
    values = [float(field) if _is_number(field) else np.nan for field in row.fields]
    return values[:width] + [np.nan] * (width - len(values))


def _roughness(values: Float[np.ndarray, "row column"]) -> Float[np.ndarray, " column"]:
    """Sum of the second differences of each column, over its range."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array(
        [
            np.abs(np.diff(column, 2)).sum() / np.ptp(column) if len(set(column)) > 1 else 0.0
            for column in columns
        ]
    )


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
        rows.append(Row(line, fields, count, sum(map(bool, fields)) - count))
    return rows


def _number(cell: Cell, comma: bool = False) -> str:
    """A number with a decimal point, and no marks between thousands; empty if it is none."""
    if not isinstance(cell, str):
        return repr(cell)
    if cell.isdecimal():
        return cell
    pointed = cell.translate(EXCHANGED) if comma else cell
    return pointed.replace(",", "") if NUMBER.fullmatch(pointed) else ""


def _blocks(rows: Sequence[Row], fits: Fits) -> list[Block]:
    """The tables of a sheet in their order."""
    blocks: list[Block] = []
    texts: list[Row] = []  # rows without a number since the last one with some
    for row in rows:
        if not row.numbers:
            texts.append(row)
            continue
        block = blocks[-1] if blocks else None
        if block is not None and len(row.fields) == len(block.rows[-1].fields):
            if _directly_below(block, texts, row, fits):
                block.rows.extend([*texts, row])
            elif _continues(block.rows, texts, row):
                block.rows.append(row)
            else:
                blocks.append(_begun(row, texts, blocks, fits))
        elif block is not None and _is_part(row, block.rows[-1]):
            blocks[-1] = block._replace(broken=block.broken or row)
        else:
            blocks.append(_begun(row, texts, blocks, fits))
        texts = []
    return blocks


def _directly_below(block: Block, texts: list[Row], row: Row, fits: Fits) -> bool:
    """Whether a row and rows without a number before it, such as ``nan``, go on with a table."""
    headers = block.headers or []
    if row.line - block.rows[-1].line != len(texts) + 1:
        return False
    return not texts or all(
        headers
        and len(text.fields) == len(row.fields)
        and not fits(text.fields)
        and not all(map(str.startswith, headers, text.fields))
        for text in texts
    )


def _is_part(row: Row, before: Row) -> bool:
    """Whether a row of another length, directly below, is an incomplete one."""
    labelled = _is_number(before.fields[0]) and not _is_number(row.fields[0])
    return row.line == before.line + 1 and not labelled


def _continues(rows: list[Row], texts: list[Row], row: Row) -> bool:
    """Whether a row below a gap or a remark continues the first column of numbers of a table."""
    last = [number for number in map(_first_number, rows[-LAST_ROWS:]) if number is not None]
    number = _first_number(row)
    if number is None or not last:
        return False
    reach = CONTINUED * float(np.abs(np.diff(last)).max(initial=0.0))
    if texts:
        return last[-1] < number <= last[-1] + reach
    return number >= last[-1] - reach


def _first_number(row: Row) -> float | None:
    return next((float(field) for field in row.fields if _is_number(field)), None)


def _begun(row: Row, texts: list[Row], blocks: list[Block], fits: Fits) -> Block:
    """A table that begins with a row, below rows of text; its header may be that of another."""
    width = len(row.fields)
    near = list(takewhile(lambda text: abs(len(text.fields) - width) <= 1, texts[-2:][::-1]))
    headers = _headers(near)
    own = headers is not None and fits(headers)
    line = texts[0].line if texts else row.line
    for before in [] if own else reversed(blocks):
        inherited = before.headers if len(before.rows[0].fields) == width else None
        if inherited and (headers is None or fits(inherited)):
            return before._replace(rows=[row], line=line, broken=None)
    above = list(takewhile(lambda text: len(text.fields) == len(headers or ()), texts[::-1]))
    line = near[-1].line if near else row.line
    return Block(headers, [row], above[::-1], line)


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
