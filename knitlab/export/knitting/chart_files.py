"""Stitches read from a file: rows of text, a table, an image of one pixel a stitch, or knitout."""

from collections import Counter, defaultdict
from collections.abc import Iterable
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
    """The stitches of a file, and a remark on them; InputError if there is no chart."""
    suffix = path.suffix.lower()
    if suffix in PROGRAMS:
        return _of_program(path, carrier)
    lines = _of_image(path) if suffix in IMAGES else _of_text(path)
    return (lines[::-1] if first == "bottom" else lines), ""


def _of_text(path: Path) -> Stitches:
    rows: list[list[bool]] = []
    is_table = False
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        is_table = is_table or line.startswith("course,")
        if not line.strip() or line.startswith(("#", "course,")):
            continue
        # knitlab's own table has the course in its first column, and kA for a plated stitch.
        of_table = (word.strip()[:1] for word in line.split(",")[1:])
        symbols = "".join(of_table if is_table else (c for c in line if c not in SEPARATORS))
        for stitch, symbol in enumerate(symbols, start=1):
            if symbol not in KNITS + PURLS:
                message = f"stitch {stitch} is {symbol!r}; write {' '.join(KNITS)} for a knit"
                where = f"{path}: line {number}"
                raise invalid(where, f"{message} and {' '.join(PURLS)} for a purl, nothing else")
        if rows and len(symbols) != len(rows[0]):
            message = f"has {len(symbols)} stitches, and the first row {len(rows[0])}"
            raise invalid(f"{path}: line {number}", f"{message}; give all rows the same")
        rows.append([symbol in KNITS for symbol in symbols])
    if not rows or not rows[0]:
        raise invalid(str(path), "has no stitches; write a row of k and p for each course")
    return np.array(rows)


def _of_image(path: Path) -> Stitches:
    pixels = read_image(path).astype(int)
    if pixels[..., 3].min() < 255:
        raise invalid(str(path), "has transparent pixels; save it opaque")
    pixels = pixels[..., :3]
    colours = np.unique(pixels @ (1 << 16, 1 << 8, 1))
    if len(colours) > 2:
        message = f"has {len(colours)} colours; save it with one pixel a stitch in two colours"
        raise invalid(str(path), message)
    lightness = pixels.sum(axis=-1)
    return lightness == lightness.max()


def _of_program(path: Path, carrier: int | None) -> tuple[Stitches, str]:
    """The stitches of a carrier, or the one that knits most of a program, up to its bind-off."""
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
        message = f"knits on both beds of a wale until line {double}, a tube or double cloth"
        raise invalid(str(path), f"{message}; only single cloth is a chart")
    if not counts:
        raise invalid(str(path), "knits no stitch through another; give a program that knits")
    body = str(carrier) if carrier else counts.most_common(1)[0][0]
    if body not in counts:
        listed = ", ".join(sorted(counts))
        raise invalid(str(path), f"knits nothing with carrier {body}; name one of {listed}")
    remarks = []
    if double:
        remarks.append(f"from line {double + 1}, before which both beds knit")
    if len(counts) > 1 and not marked:
        remarks.append(f"of carrier {body} alone")
    if joined:
        remarks.append(f"up to line {joined}, that joins loops")
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
            raise invalid(str(path), f"{message} {courses} on others; only a rectangle is a chart")
    first, end = min(chains), max(chains)
    if len(chains) != end - first + 1:
        missing = next(n for n in range(first, end) if n not in chains)
        raise invalid(str(path), f"knits nothing on needle {missing} between others; close the gap")
    return np.array([chains[number] for number in range(first, end + 1)]).T, ", ".join(remarks)


def _knitted(
    program: Iterable[Operation], counted: range
) -> tuple[list[tuple[Needle, tuple[str, ...]]], int, int]:
    """The stitches of counted lines until loops are joined, with their carriers, and two lines.

    The last line that knits where the other bed holds a loop of the wale, and that from which on a
    bind-off or a decrease joins loops; 0 if there is none. No rule of a machine is checked.
    """
    loops: Counter[Needle] = Counter()
    stitches: list[tuple[Needle, tuple[str, ...]]] = []
    double = joined = 0
    for operation in program:
        opcode, needles = operation.opcode, operation.needles
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
