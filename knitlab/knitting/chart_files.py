"""Stitches read from a file: rows of text, a table, an image of one pixel a stitch, or knitout."""

from collections import Counter, defaultdict
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool

from knitlab.io.errors import fault
from knitlab.io.text_file import read_text
from knitlab.knitting.program import Needle, Operation, operations

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
    """The stitches of a file, and a remark on what of it they are; BadInput if it has no chart."""
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
        if is_table:
            # knitlab's own table has the course in its first column, and kA for a plated stitch.
            symbols = "".join(word.strip()[:1] for word in line.split(",")[1:])
        else:
            symbols = "".join(each for each in line if each not in SEPARATORS)
        for stitch, symbol in enumerate(symbols, start=1):
            if symbol not in KNITS + PURLS:
                problem = f"stitch {stitch} is {symbol!r}; write {' '.join(KNITS)} for a knit"
                where = f"{path}: line {number}"
                raise fault(where, f"{problem} and {' '.join(PURLS)} for a purl, nothing else")
        if rows and len(symbols) != len(rows[0]):
            problem = f"has {len(symbols)} stitches, and the first row {len(rows[0])}"
            raise fault(f"{path}: line {number}", f"{problem}; give all rows the same")
        rows.append([symbol in KNITS for symbol in symbols])
    if not rows or not rows[0]:
        raise fault(str(path), "has no stitches; write a row of k and p for each course")
    return np.array(rows)


def _of_image(path: Path) -> Stitches:
    from PIL import Image  # slow to import, and only used here

    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGBA")).astype(int)
    except OSError as error:
        problem = f"cannot be read as an image ({error}); check the path, or save it as PNG"
        raise fault(str(path), problem) from error
    if pixels[..., 3].min() < 255:
        raise fault(str(path), "has transparent pixels; save it opaque")
    pixels = pixels[..., :3]
    colours = np.unique(pixels @ (1 << 16, 1 << 8, 1))
    if len(colours) > 2:
        problem = f"has {len(colours)} colours; save it with one pixel a stitch in two colours"
        raise fault(str(path), problem)
    lightness = pixels.sum(axis=-1)
    return lightness == lightness.max()


def _of_program(path: Path, carrier: int | None) -> tuple[Stitches, str]:
    """The stitches of a carrier, or the one that knits most of a program, up to its bind-off."""
    text = read_text(path)
    lines = text.split("\n")
    if FIRST_COURSE in lines:
        # A program of knitlab says where its chart begins and ends.
        start = lines.index(FIRST_COURSE)
        last = next((k for k in range(start, len(lines)) if lines[k] in AFTER_BODY), len(lines))
    else:
        start, last = 0, len(lines)
    formed = _Knitted()
    for operation in operations(text):
        formed.follow(operation, counts=start < operation.line <= last)
    counts = Counter(each for _, carriers in formed.stitches for each in carriers)
    if not counts and formed.double:
        problem = f"knits on both beds of a wale until line {formed.double}, a tube or double cloth"
        raise fault(str(path), f"{problem}; only single cloth is a chart")
    if not counts:
        raise fault(str(path), "knits no stitch through another; give a program that knits")
    body = str(carrier) if carrier else counts.most_common(1)[0][0]
    if body not in counts:
        listed = ", ".join(sorted(counts))
        raise fault(str(path), f"knits nothing with carrier {body}; name one of {listed}")
    remarks = []
    if formed.double:
        remarks.append(f"from line {formed.double + 1}, before which both beds knit")
    if len(counts) > 1 and FIRST_COURSE not in lines:
        remarks.append(f"of carrier {body} alone")
    chains: dict[int, list[bool]] = defaultdict(list)
    for needle, carriers in formed.stitches:
        if body in carriers:
            chains[needle.number].append(needle.front)
    courses = Counter(map(len, chains.values())).most_common(1)[0][0]
    if formed.double:
        # Of the course in which both beds knit last, a part may count.
        chains = {number: chain[-courses:] for number, chain in chains.items()}
    if formed.joined:
        # A bind-off has knitted the first stitch of its course, or none.
        remarks.append(f"up to line {formed.joined}, that joins loops")
        chains = {number: chain[:courses] for number, chain in chains.items()}
    for number, chain in sorted(chains.items()):
        if len(chain) != courses:
            problem = f"has {len(chain)} stitches of carrier {body} on needle {number}, and"
            remedy = "only a rectangle is a chart"
            raise fault(str(path), f"{problem} {courses} on others; {remedy}")
    first, end = min(chains), max(chains)
    if len(chains) != end - first + 1:
        missing = next(n for n in range(first, end) if n not in chains)
        raise fault(str(path), f"knits nothing on needle {missing} between others; close the gap")
    return np.array([chains[number] for number in range(first, end + 1)]).T, ", ".join(remarks)


class _Knitted:
    """The stitches that a program forms, without any rule of a machine."""

    def __init__(self) -> None:
        self.loops: Counter[Needle] = Counter()
        self.double = 0  # last line that knits where the other bed holds a loop of the wale
        self.joined = 0  # line from which on a bind-off or a decrease joins loops
        self.stitches: list[tuple[Needle, tuple[str, ...]]] = []  # with their carriers

    def follow(self, operation: Operation, counts: bool) -> None:
        """Take the loops on by an operation; its stitch counts until loops are joined."""
        opcode, needles = operation.opcode, operation.needles
        counts = counts and not self.joined
        if opcode in ("knit", "tuck") and needles and operation.carriers:
            (needle,) = needles
            if opcode == "knit":
                if self.loops[Needle(not needle.front, needle.number)]:
                    # Waste is often knitted on both beds; a chart can only begin after that.
                    self.stitches.clear()
                    self.double = operation.line
                elif self.loops[needle] and counts:
                    self.stitches.append((needle, operation.carriers))
                self.loops[needle] = 0
            self.loops[needle] += 1
        elif opcode in ("xfer", "split") and len(needles) == 2:
            source, target = needles
            if self.loops[source] and self.loops[target] and counts:
                self.joined = operation.line
            self.loops[target] += self.loops[source]
            self.loops[source] = int(opcode == "split")
        elif opcode in ("drop", "knit") and needles:
            self.loops[needles[0]] = 0
