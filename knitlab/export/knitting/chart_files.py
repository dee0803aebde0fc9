"""Stitches read from a file: rows of text, a table, an image of one pixel a stitch, or knitout."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool

from knitlab.export.knitting.program import Needle, Operation, operations
from knitlab.io.errors import invalid
from knitlab.io.image_file import read_image
from knitlab.io.text_file import read_text

KNITS, PURLS = "kK.1", "pP-0"  # symbols of a chart that is seen from the front
SEPARATORS = " \t,;|"
IMAGES = (".png", ".bmp", ".gif", ".tif", ".tiff", ".jpg", ".jpeg")
PROGRAMS = (".k", ".knitout")
FIRST_COURSE, AFTER_BODY = ";course 1", (";bind-off", ";waste", ";drop")  # as knitlab writes them

Edge = Literal["bottom", "top"]  # of a file, that is knitted first
Stitches = Bool[np.ndarray, "course wale"]  # whether knit, seen from the front, first course first


def read_stitches(
    path: Path, first: Edge = "bottom", carrier: int | None = None
) -> tuple[Stitches, str]:
    """The stitches of a file, whose ``first`` edge is knitted first, and a remark on them."""
    suffix = path.suffix.lower()
    if suffix in PROGRAMS:
        return _stitches_of_program(path, carrier)
    rows = READERS.get(suffix, _rows_of_text)(path)
    return (rows[::-1] if first == "bottom" else rows), ""


def _rows_of_text(path: Path) -> Stitches:
    rows: list[list[bool]] = []
    is_table = False
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        where = f"{path}: line {number}"
        if line.startswith("course,"):
            is_table = True  # of knitlab: after the course, kA for a plated stitch
            continue
        if not line.strip() or line.startswith("#"):
            continue
        letters = (word.strip()[:1] for word in line.split(",")[1:]) if is_table else line
        symbols = "".join(letter for letter in letters if letter not in SEPARATORS)
        for stitch, symbol in enumerate(symbols, start=1):
            if symbol not in KNITS + PURLS:
                message = f"stitch {stitch} is {symbol!r}; write {' '.join(KNITS)} for a knit"
                raise invalid(where, f"{message} and {' '.join(PURLS)} for a purl, nothing else")
        if rows and len(symbols) != len(rows[0]):
            message = f"has {len(symbols)} stitches, but the first row has {len(rows[0])}"
            raise invalid(where, f"{message}; make all rows equally long")
        rows.append([symbol in KNITS for symbol in symbols])
    if not rows or not rows[0]:
        raise invalid(str(path), "has no stitches; write a row of k and p for each course")
    return np.array(rows)


def _rows_of_image(path: Path) -> Stitches:
    pixels = read_image(path).astype(int)
    if pixels[..., 3].min() < 255:
        raise invalid(str(path), "has transparent pixels; save it opaque")
    pixels = pixels[..., :3]
    colours = np.unique(pixels @ (1 << 16, 1 << 8, 1))
    if len(colours) > 2:
        message = f"has {len(colours)} colours; save it in two colours with one pixel per stitch"
        raise invalid(str(path), message)
    lightness = pixels.sum(axis=-1)
    return lightness == lightness.max()


READERS: dict[str, Callable[[Path], Stitches]] = dict.fromkeys(IMAGES, _rows_of_image)
"""What reads the rows of a file, the top first, by its suffix; other files are text."""


def _stitches_of_program(path: Path, carrier: int | None) -> tuple[Stitches, str]:
    text = read_text(path)
    lines = text.split("\n")
    # A program of knitlab says where its chart begins and ends.
    marked = FIRST_COURSE in lines
    start = lines.index(FIRST_COURSE) if marked else 0
    ends = (k for k in range(start, len(lines)) if marked and lines[k] in AFTER_BODY)
    last = next(ends, len(lines))
    stitches, double, joined = _knitted(operations(text), range(start + 1, last + 1))
    counts = Counter(each for _, carriers in stitches for each in carriers)
    if not counts and double:
        message = f"knits on both beds of a wale until line {double}: a tube or double cloth"
        raise invalid(str(path), f"{message}; only single cloth has a chart")
    if not counts:
        raise invalid(str(path), "knits no stitch through another one; give a program that knits")
    body = str(carrier) if carrier else counts.most_common(1)[0][0]
    if body not in counts:
        listed = ", ".join(sorted(counts))
        raise invalid(str(path), f"knits nothing with carrier {body}; name one of {listed}")
    remarks = []
    if double:
        remarks.append(f"from line {double + 1}; before it both beds knit")
    if len(counts) > 1 and not marked:
        remarks.append(f"of carrier {body} alone")
    if joined:
        remarks.append(f"up to line {joined}, which joins loops")
    chains: dict[int, list[bool]] = defaultdict(list)
    for needle, carriers in stitches:
        if body in carriers:
            chains[needle.number].append(needle.front)
    courses = Counter(map(len, chains.values())).most_common(1)[0][0]
    for number, chain in sorted(chains.items()):
        if double:
            # Of the course in which both beds knit last, some stitches may count.
            del chain[:-courses]
        if joined:
            # A bind-off has knitted the first stitch of its course, or none.
            del chain[courses:]
        if len(chain) != courses:
            message = f"has {len(chain)} stitches of carrier {body} on needle {number}, and"
            raise invalid(str(path), f"{message} {courses} on others; only a rectangle has a chart")
    first = min(chains)
    end = max(chains)
    if len(chains) != end - first + 1:
        missing = next(n for n in range(first, end) if n not in chains)
        raise invalid(str(path), f"knits nothing on needle {missing} between others; close the gap")
    return np.array([chains[number] for number in range(first, end + 1)]).T, ", ".join(remarks)


def _knitted(
    program: Iterable[Operation], counted: range
) -> tuple[list[tuple[Needle, tuple[str, ...]]], int, int]:
    """The stitches of counted lines until loops are joined, with their carriers, and two lines.

    The last line at which both beds knit, and that at which a bind-off joins loops; 0 for none.
    """
    loops: Counter[Needle] = Counter()
    stitches: list[tuple[Needle, tuple[str, ...]]] = []
    double = joined = 0
    for operation in program:
        opcode = operation.opcode
        needles = operation.needles
        counts = operation.line in counted and not joined
        if opcode in ("knit", "tuck") and needles and operation.carriers:
            (needle,) = needles
            if opcode == "knit":
                if loops[Needle(not needle.front, needle.number)]:
                    # Waste is often knitted on both beds; a chart can only begin after that.
                    stitches.clear()
                    double = operation.line
                elif loops[needle] and counts:
                    stitches.append((needle, operation.carriers))
                loops[needle] = 0
            loops[needle] += 1
        elif opcode in ("xfer", "split") and len(needles) == 2:
            source, target = needles
            if loops[source] and loops[target] and counts:
                joined = operation.line
            loops[target] += loops[source]
            loops[source] = int(opcode == "split")
        elif opcode in ("drop", "knit") and needles:
            loops[needles[0]] = 0
    return stitches, double, joined
