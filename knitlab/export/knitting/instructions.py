"""A stitch chart in the words of hand knitting: row by row, with repeats.

On the right side, the front, a row is knitted from the right wale to the left; on the wrong side
from the left to the right, where a knit is purled. Rounds are all knitted on the right side.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby

from knitlab.export.knitting.chart import StitchChart, electrode_name

MAX_LISTED = 3  # rows that are numbered one by one
Stitch = tuple[bool, int]  # whether it is knitted, else purled, and its electrode's number or 0


def instructions(chart: StitchChart, in_the_round: bool = False) -> str:
    """Words that knit a chart by hand, to and fro or in the round."""
    row = "row"
    period = 2
    sides = "RS: right side, WS: wrong side, "
    if in_the_round:
        row = "round"
        period = 1
        sides = ""
    terms = f"k: knit, p: purl, st(s): stitch(es), {sides}rep: repeat."
    lines = [" ".join(chart.title.split()), "", terms]
    for number in chart.electrodes:
        name = electrode_name(number)
        side = "right" if chart.plated_face[number - 1] == "front" else "wrong"
        lines.append(f"with {name}: hold conductor {name} with the yarn, on the {side} side.")
    join = ", join in the round" if in_the_round else ""
    lines += ["", f"Cast on {chart.wales} sts{join}."]
    worked = [_worked(chart, course, in_the_round) for course in range(chart.courses)]
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
            lines.append(f"{_rows(row, numbers)}: {row_in_words(worked[first])}.")
        start = stop
    if more:
        times = "once more" if more == 1 else f"{more} times more"
        lines.append(f"Rep {row}s 1 to {courses} {times}.")
    return "\n".join([*lines, "Bind off.", ""])


def _rows(row: str, numbers: range) -> str:
    side = "" if row == "round" else f" ({'RS' if numbers[0] % 2 else 'WS'})"
    if len(numbers) <= MAX_LISTED:
        listed = ", ".join(map(str, numbers[:-1]))
        several = f"{listed} and {numbers[-1]}" if listed else str(numbers[-1])
        return f"{row.capitalize()}{'s' if listed else ''} {several}{side}"
    which = f"{row.capitalize()}s" if not side else f"{'Odd' if numbers[0] % 2 else 'Even'} {row}s"
    return f"{which} {numbers[0]} to {numbers[-1]}{side}"


def _worked(chart: StitchChart, course: int, in_the_round: bool) -> list[Stitch]:
    """The stitches of a course in the order in which they are worked."""
    pairs = zip(chart.front[course].tolist(), chart.plated[course].tolist(), strict=True)
    if in_the_round or course % 2 == 0:
        return list(pairs)[::-1]
    return [(not front, electrode) for front, electrode in pairs]


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
    for (knitted, electrode), of in groupby(stitches):
        conductor = f" with {electrode_name(electrode)}" if electrode else ""
        terms.append(f"{'k' if knitted else 'p'}{len(list(of))}{conductor}")
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
