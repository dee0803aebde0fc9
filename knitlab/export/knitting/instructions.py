"""A stitch chart in the words of hand knitting: row by row, with repeats.

On the right side, the front, a row is knitted from the right wale to the left; on the wrong side
from the left to the right, where a knit is purled. Rounds are all knitted on the right side.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

from knitlab.export.knitting.chart import StitchChart, electrode_name
from knitlab.export.knitting.shaping import MAX_MOVED, CourseShaping, shaping
from knitlab.io.errors import invalid

MAX_LISTED = 3  # rows that are numbered one by one
# Whether it is knitted, else purled; its electrode's number or 0; and its term, if not k or p.
Stitch = tuple[bool, int, str]
PURLED = {"m1": "m1p", "ssk": "ssp", "k2tog": "p2tog"}
SHAPING_TERMS = """ssk, k2tog: knit 2 sts together, leaning left, right; ssp, p2tog: purl them.
m1, m1p: make 1 st, a knit or a purl, from the strand before the next st."""


class Row(NamedTuple):
    """A row as it is worked, between what its beginning and its end add or take away."""

    stitches: list[Stitch]
    begins: list[str]
    ends: list[str]
    length: int  # stitches after it

    def __str__(self) -> str:
        if not (self.begins or self.ends or any(term for _, _, term in self.stitches)):
            return row_in_words(self.stitches)
        terms = ", ".join([*self.begins, *_brackets(_terms(self.stitches)), *self.ends])
        return f"{terms} ({_in_sts(self.length)})"


def instructions(chart: StitchChart, in_the_round: bool = False) -> str:
    """Words that knit a chart by hand, to and fro or in the round.

    Raises:
        InputError: if a shaped piece is to be knitted in the round, or binds stitches off in the
            row that casts them on.
    """
    is_shaped = chart.spans is not None
    if in_the_round and is_shaped:
        raise invalid("in_the_round", "needs a whole tube, and the piece is shaped; leave it out")
    row = "row"
    period = 2
    sides = "RS: right side, WS: wrong side, "
    if in_the_round:
        row = "round"
        period = 1
        sides = ""
    terms = f"k: knit, p: purl, st(s): stitch(es), {sides}rep: repeat."
    lines = [" ".join(chart.title.split()), "", terms]
    if is_shaped:
        lines.append(SHAPING_TERMS)
    for number in chart.electrodes:
        name = electrode_name(number)
        side = "right" if chart.plated_face[number - 1] == "front" else "wrong"
        lines.append(f"with {name}: hold conductor {name} with the yarn, on the {side} side.")
    join = ", join in the round" if in_the_round else ""
    lines += ["", f"Cast on {int(chart.present[0].sum())} sts{join}."]
    worked = _rows(chart, in_the_round)
    courses = chart.repeat[0]
    more = chart.courses // courses - 1
    if courses % period or worked != worked[:courses] * (more + 1):
        courses = chart.courses
        more = 0
    start = 0
    while start < courses:
        following = range(start + period, courses)
        stop = next((k for k in following if worked[k] != worked[k - period]), courses)
        for first in range(start, min(stop, start + period)):
            numbers = range(first + 1, stop + 1, period)
            lines.append(f"{_numbers(row, numbers)}: {worked[first]}.")
        start = stop
    if more:
        times = "once more" if more == 1 else f"{more} times more"
        lines.append(f"Rep {row}s 1 to {courses} {times}.")
    return "\n".join([*lines, "Bind off.", ""])


def _numbers(row: str, numbers: range) -> str:
    side = "" if row == "round" else f" ({'RS' if numbers[0] % 2 else 'WS'})"
    if len(numbers) <= MAX_LISTED:
        listed = ", ".join(map(str, numbers[:-1]))
        several = f"{listed} and {numbers[-1]}" if listed else str(numbers[-1])
        return f"{row.capitalize()}{'s' if listed else ''} {several}{side}"
    which = f"{row.capitalize()}s" if not side else f"{'Odd' if numbers[0] % 2 else 'Even'} {row}s"
    return f"{which} {numbers[0]} to {numbers[-1]}{side}"


def _in_sts(count: int) -> str:
    return "1 st" if count == 1 else f"{count} sts"


def _rows(chart: StitchChart, in_the_round: bool) -> list[Row]:
    """The courses in the order in which their stitches are worked."""
    rows = []
    grown = 0  # at the end of a course, which the course before knows
    for course, changes in enumerate(shaping(chart, -1, MAX_MOVED)):
        start, stop = chart.edges[course].tolist()
        right_side = in_the_round or course % 2 == 0
        direction = -1 if right_side else 1
        pairs = zip(chart.front[course].tolist(), chart.plated[course].tolist(), strict=True)
        stitches = [(front == right_side, each, "") for front, each in pairs][start:stop]
        bound_off = [each for each in changes.bound_off if start < each <= stop]
        rows.append(_row(stitches[::direction], direction, changes, len(bound_off), grown))
        grown = len(changes.cast_on_ahead)
    return rows


def _row(
    stitches: list[Stitch], direction: int, changes: CourseShaping, n_bound: int, grown: int
) -> Row:
    """A row of stitches, with its first ones bound off and its last ones cast on, if any."""
    count = len(stitches)
    if n_bound + grown >= count:
        message = "must bind off stitches that it casts on; narrow the piece a few courses later"
        raise invalid(f"chart: a row of {_in_sts(count)}", message)
    # Loops are moved in the direction of the row at its beginning, against it at its end.
    lost = {shift * direction > 0: len(needles) for needles, shift in changes.moved}
    first, last = lost.get(True, 0), lost.get(False, 0)
    terms = ["ssk"] * first + [""] * (count - first - last) + ["k2tog"] * last
    taken_off = len(changes.bound_off) + len([each for each in terms[:n_bound] if each])
    gained = len(changes.cast_on)
    begins = []
    ends = []
    # A stitch is made between that at the edge and the next, if the row has room for all changes.
    needed = first + last + 2 * (gained == 1) + 2 * (grown == 1)
    has_room = count - n_bound - (grown if grown > 1 else 0) >= max(needed, 3)
    if gained == 1 and has_room and not n_bound:
        terms[1] = "m1"
    elif gained:
        begins.append(f"cast on {_in_sts(gained)}")
    if taken_off:
        begins.append(f"bind off {_in_sts(taken_off)}")
    if grown == 1 and has_room:
        terms[-2] = "m1"
        grown = 0
    elif grown:
        ends.append(f"cast on {_in_sts(grown)}")
    worked = [(*each[:2], term) for each, term in zip(stitches, terms, strict=True)]
    return Row(worked[n_bound : count - grown], begins, ends, count - n_bound)


def row_in_words(stitches: Sequence[Stitch]) -> str:
    """A row in words: ``*k4, p4; rep from * to end``."""
    count = len(stitches)
    if len(set(stitches)) == 1 and not stitches[0][1]:
        return "knit" if stitches[0][0] else "purl"
    for size in range(1, count // 2 + 1):
        if count % size == 0 and list(stitches[:size]) * (count // size) == list(stitches):
            return f"*{', '.join(_brackets(_terms(stitches[:size])))}; rep from * to end"
    return ", ".join(_brackets(_terms(stitches)))


def _terms(stitches: Sequence[Stitch]) -> list[str]:
    terms = []
    for (knitted, electrode, term), of in groupby(stitches):
        conductor = f" with {electrode_name(electrode)}" if electrode else ""
        count = len(list(of))
        if term:
            terms += [f"{term if knitted else PURLED[term]}{conductor}"] * count
        else:
            terms.append(f"{'k' if knitted else 'p'}{count}{conductor}")
    return terms


def _brackets(terms: list[str]) -> Iterator[str]:
    """Terms in which a group that is repeated next to itself stands once, in brackets."""
    start = 0
    while start < len(terms):
        size, times = max(
            ((size, _times(terms, start, size)) for size in range(1, len(terms) - start + 1)),
            # The group that saves most terms, and of these the shortest.
            key=lambda group: (group[0] * (group[1] - 1), -group[0]),
        )
        group = ", ".join(terms[start : start + size])
        yield group if times == 1 else f"[{group}] {times} times"
        start += size * times


def _times(terms: list[str], start: int, size: int) -> int:
    group = terms[start : start + size]
    times = 1
    while terms[start + size * times : start + size * (times + 1)] == group:
        times += 1
    return times
