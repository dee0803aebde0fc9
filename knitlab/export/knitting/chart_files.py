"""Stitches read from a file: rows of text, a table, an image of one pixel a stitch, or knitout."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from knitlab.export.knitting.program_chart import Stitches, stitches_of_program
from knitlab.export.knitting.symbols import BETWEEN, UNKNOWN, Key, key_of_chart
from knitlab.io.errors import invalid
from knitlab.io.image_file import read_image
from knitlab.io.limits import MAX_TEXT
from knitlab.io.text_file import check_grid, read_text

CELL_ENDS = ",;\t"
ALIKE = str.maketrans("KP", "kp")
IMAGES = (".png", ".bmp", ".gif", ".tif", ".tiff", ".jpg", ".jpeg")
PROGRAMS = (".k", ".knitout")
LIGHTNESS = np.array([[1, 1, 1], [2, 7, 1]])  # weights of red, green and blue: alike, and as seen

Edge = Literal["bottom", "top"]  # of a file, that is knitted first


def read_stitches(
    path: Path, first: Edge = "bottom", carrier: int | None = None, given: Key = UNKNOWN
) -> tuple[Stitches, str]:
    """The stitches of a file, whose ``first`` edge is knitted first, and a remark on them.

    ``given`` is what the user says of the symbols of a chart.
    """
    if given.knit is not None and given.knit == given.purl:
        raise invalid("knit", f"is {given.knit!r}, and so is purl; give two symbols")
    suffix = path.suffix.lower()
    if suffix in PROGRAMS:
        if given.symbols:
            raise invalid(str(path), f"is a program, which has no symbols; leave out {given}")
        return stitches_of_program(path, carrier)
    rows, key = READERS.get(suffix, _rows_of_text)(path, given)
    return (rows[::-1] if first == "bottom" else rows), str(key)


def _rows_of_text(path: Path, given: Key) -> tuple[Stitches, Key]:
    given = Key(*(each and each.translate(ALIKE) for each in (given.knit, given.purl)))
    for symbol in given.symbols:
        if len(symbol) != 1:
            raise invalid(str(path), f"has one character a stitch; give one in place of {symbol!r}")
    lines = read_text(path, MAX_TEXT).translate(ALIKE).splitlines()
    check_grid(path, len(lines), max(map(len, lines), default=0), "characters", MAX_TEXT)
    rows = _symbols(path, lines, given)
    drawn = list(dict.fromkeys("".join(rows.values())))
    between = [each for each in drawn if each in BETWEEN and each not in given.symbols]
    if between:
        left_out = dict.fromkeys(map(ord, between))
        kept = ((line, row.translate(left_out)) for line, row in rows.items())
        rows = {line: row for line, row in kept if row}
    if not rows:
        raise invalid(str(path), "has no stitches; write a row of k and p for each course")
    drawn = [each for each in drawn if each not in between]
    if len(given.symbols) == 1 and given.symbols[0] not in drawn and all(rows.values()):
        listed = ", ".join(map(repr, (*drawn, *between)))
        message = f"has no {given.symbols[0]!r}; its symbols are {listed}, name these"
        raise invalid(str(path), message)
    known = list(dict.fromkeys([*given.symbols, *drawn]))[:2]
    width = len(next(iter(rows.values())))
    for line, row in rows.items():
        if other := row.strip("".join(known)):
            message = f"stitch {row.index(other[0]) + 1} is {other[0]!r}, beside"
            message += f" {' and '.join(map(repr, known))}; only knits and purls are read,"
            raise invalid(f"{path}: line {line}", f"{message} so write one symbol for each")
        if len(row) != width:
            message = f"has {len(row)} stitches, but the first row has {width}"
            hint = "make all rows equally long"
            if " " in known:
                hint += ", with blanks at their ends" if row else ", or remove this line"
            raise invalid(f"{path}: line {line}", f"{message}; {hint}")
    check_grid(path, len(rows), width)
    key = key_of_chart(str(path), drawn, between, given)
    return np.array([[each == key.knit for each in row] for row in rows.values()]), key


def _symbols(path: Path, lines: Sequence[str], given: Key) -> dict[int, str]:
    """The symbols of each row by its line from 1, those that may separate stitches included."""
    ends = re.compile(f"[{re.escape(''.join(set(CELL_ENDS) - set(given.symbols)))}]")
    plain = [line for line in lines if not line.startswith("#")]
    lengths = set(map(len, plain))
    symbols = {"#"}.union(*plain)
    empty = "" if " " in given.symbols else " "
    rows = dict[int, str]()
    is_table = False
    for number, line in enumerate(lines, start=1):
        is_row = "#" in given.symbols or (len(line) in lengths and symbols.issuperset(line))
        if line.startswith("course,"):
            is_table = True  # of knitlab: after the course, kA for a plated stitch
        elif is_row or not line.startswith("#"):
            cells = [line]
            if ends.search(line):
                cells = [cell.strip(' "') or " " for cell in ends.split(line)]
            if is_table:
                cells = cells[1:]
                if " " in cells and " " not in given.symbols:
                    where = f"has no stitch in wale {cells.index(' ') + 1}: a shaped piece"
                    message = f"{where}; only a rectangle has a pattern, give one"
                    raise invalid(f"{path}: line {number}", message)
            row = "".join([cell[0] for cell in cells] if is_table else cells)
            rows[number] = row or empty
    return rows


def _rows_of_image(path: Path, given: Key) -> tuple[Stitches, Key]:
    pixels = read_image(path).astype(int)
    if pixels[..., 3].min() < 255:
        raise invalid(str(path), "has transparent pixels; save it opaque")
    numbers = pixels[..., :3] @ (1 << 16, 1 << 8, 1)
    colours, firsts = np.unique(numbers, return_index=True)
    if len(colours) > 2:
        message = f"has {len(colours)} colours; save it in two colours with one pixel per stitch"
        raise invalid(str(path), message)
    names = [f"#{colour:06x}" for colour in colours.tolist()]
    given = Key(*(each and each.lower() for each in (given.knit, given.purl)))
    if unknown := {*given.symbols} - {*names}:
        message = f"has no colour {min(unknown)!r}; its colours are {' and '.join(names)}"
        raise invalid(str(path), f"{message}, name these")
    lightness = pixels.reshape(-1, 4)[firsts, :3] @ LIGHTNESS.T
    if len(names) == 2 and not given.symbols:
        lighter = set(np.sign(lightness[0] - lightness[1]).tolist())
        if lighter == {1}:
            given = Key(names[0], names[1])
        elif lighter == {-1}:
            given = Key(names[1], names[0])
    key = key_of_chart(str(path), names, [], given)
    return numbers == (-1 if key.knit is None else int(key.knit[1:], 16)), key


READERS: dict[str, Callable[[Path, Key], tuple[Stitches, Key]]] = dict.fromkeys(
    IMAGES, _rows_of_image
)
"""What reads the rows of a file, the top first, by its suffix; other files are text."""
