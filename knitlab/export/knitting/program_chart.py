"""The stitches of a program for single cloth, whether or not knitlab wrote it."""

from collections import Counter, defaultdict
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from knitlab.export.knitting.program import Needle, Operation, is_ahead, operations
from knitlab.io.errors import invalid
from knitlab.io.limits import MAX_STITCHES, MAX_TEXT
from knitlab.io.text_file import read_text

FIRST_COURSE, AFTER_BODY = ";course 1", (";bind-off", ";waste", ";drop")  # as knitlab writes them

Stitches = Bool[np.ndarray, "course wale"]  # whether knit, seen from the front, first course first


def stitches_of_program(path: Path, carrier: int | None) -> tuple[Stitches, str]:
    """The stitches of a carrier, by default of the one that knits most, and a remark on them."""
    text = read_text(path, MAX_TEXT)
    if (number := text.count("\nknit ")) > MAX_STITCHES:
        raise invalid(str(path), f"knits {number:,} stitches; give at most {MAX_STITCHES:,}")
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
    if marked and joined:
        message = f"joins loops at line {joined}, before its end: a shaped piece"
        raise invalid(str(path), f"{message}; only a rectangle has a pattern")
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
    numbers = sorted(chains)
    steps = sorted({after - before for before, after in pairwise(numbers)})
    if len(steps) > 1:
        missing = next(n for n in range(numbers[0], numbers[-1], steps[0]) if n not in chains)
        raise invalid(str(path), f"knits nothing on needle {missing} between others; close the gap")
    if steps not in ([], [1]):
        remarks.append(f"on one of {steps[0]} needles")
    return np.array([chains[number] for number in numbers]).T, ", ".join(remarks)


def _knitted(
    program: Iterable[Operation], counted: range
) -> tuple[list[tuple[Needle, tuple[str, ...]]], int, int]:
    """The stitches of counted lines until loops are joined, with their carriers, and two lines.

    The last line at which both beds knit, and that at which a bind-off joins loops; 0 for none.
    A course may cast on needles between those of the cast-on: on these it counts, too.
    """
    loops: Counter[Needle] = Counter()
    stitches: list[tuple[Needle, tuple[str, ...]]] = []
    double = joined = 0
    cast_on: list[tuple[Needle, tuple[str, ...]]] = []  # by the pass so far
    is_course = False  # whether that has knitted through loops, too
    last: Operation | None = None
    for operation in program:
        opcode = operation.opcode
        needles = operation.needles
        counts = operation.line in counted and not joined
        if opcode in ("knit", "tuck") and needles and operation.carriers:
            (needle,) = needles
            if last is None or not is_ahead(last, operation):
                stitches += cast_on if is_course else []
                cast_on = []
                is_course = False
            last = operation
            if opcode == "knit":
                if loops[Needle(not needle.front, needle.number)]:
                    # Waste is often knitted on both beds; a chart can only begin after that.
                    stitches.clear()
                    cast_on.clear()
                    double = operation.line
                elif counts and loops[needle]:
                    stitches.append((needle, operation.carriers))
                    is_course = True
                elif counts:
                    cast_on.append((needle, operation.carriers))
                loops[needle] = 0
            loops[needle] += 1
        elif opcode in ("xfer", "split") and len(needles) == 2:
            source, target = needles
            if loops[source] and loops[target] and counts and stitches:
                joined = operation.line
            loops[target] += loops[source]
            loops[source] = int(opcode == "split")
        elif opcode in ("drop", "knit") and needles:
            loops[needles[0]] = 0
    return stitches + (cast_on if is_course else []), double, joined
