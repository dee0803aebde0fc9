"""A stitch chart in the words of hand knitting: row by row, with repeats.

Rows go to and fro. On the right side, the front, a row is knitted from the right wale to the left;
on the wrong side from the left to the right, where a stitch that shows as a knit is purled. Rounds
are all knitted on the right side.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from knitlab.knitting.chart import StitchChart, electrode_name

MOST_LISTED = 3  # rows that are numbered one by one
Stitch = tuple[bool, int]  # whether it is knitted, else purled, and its electrode's number or 0


def instructions(chart: StitchChart, in_the_round: bool = False) -> str:
    """Words that knit a chart by hand, to and fro or in the round."""
    row = "round" if in_the_round else "row"
    courses = _courses_of_repeat(chart, in_the_round)
    lines = [
        " ".join(chart.title.split()),
        "",
        f"k: knit, p: purl, st(s): stitch(es), {_sides(in_the_round)}rep: repeat.",
    ]
    for number in chart.electrodes:
        name, face = electrode_name(number), chart.plated_face[number - 1]
        side = "right" if face == "front" else "wrong"
        lines.append(f"with {name}: hold conductor {name} with the yarn, on the {side} side.")
    join = ", join in the round" if in_the_round else ""
    lines += ["", f"Cast on {chart.wales} sts{join}."]
    start = 0
    while start < courses:
        stop = _end_of_block(chart, start, courses, in_the_round)
        for first in range(start, min(stop, start + (1 if in_the_round else 2))):
            numbers = range(first + 1, stop + 1, 1 if in_the_round else 2)
            lines.append(f"{_rows(row, numbers)}: {words_of(_worked(chart, first, in_the_round))}.")
        start = stop
    if (more := chart.courses // courses - 1) > 0:
        times = "once more" if more == 1 else f"{more} times more"
        lines.append(f"Rep {row}s 1 to {courses} {times}.")
    return "\n".join([*lines, "Bind off.", ""])


def _sides(in_the_round: bool) -> str:
    return "" if in_the_round else "RS: right side, WS: wrong side, "


def _rows(row: str, numbers: range) -> str:
    """Rows by their numbers, with their side if they go to and fro."""
    side = "" if row == "round" else f" ({'RS' if numbers[0] % 2 else 'WS'})"
    if len(numbers) <= MOST_LISTED:
        listed = ", ".join(map(str, numbers[:-1]))
        several = f"{listed} and {numbers[-1]}" if listed else str(numbers[-1])
        return f"{row.capitalize()}{'s' if listed else ''} {several}{side}"
    which = f"{row.capitalize()}s" if not side else f"{'Odd' if numbers[0] % 2 else 'Even'} {row}s"
    return f"{which} {numbers[0]} to {numbers[-1]}{side}"


def _courses_of_repeat(chart: StitchChart, in_the_round: bool) -> int:
    """Courses after which the words begin again; a whole number of pairs of rows to and fro."""
    courses = chart.repeat[0]
    if courses % 2 and not in_the_round:
        return chart.courses
    times = (chart.courses // courses, 1)
    alike = [(np.tile(of[:courses], times) == of).all() for of in (chart.front, chart.plated)]
    return courses if all(alike) else chart.courses


def _end_of_block(chart: StitchChart, start: int, courses: int, in_the_round: bool) -> int:
    """The course after those that are worked as the first of their side from a start."""
    period = 1 if in_the_round else 2
    for course in range(start + period, courses):
        before = course - period
        for stitches in (chart.front, chart.plated):
            if (stitches[course] != stitches[before]).any():
                return course
    return courses


def _worked(chart: StitchChart, course: int, in_the_round: bool) -> list[Stitch]:
    """The stitches of a course in the order in which they are worked."""
    pairs = zip(chart.front[course].tolist(), chart.plated[course].tolist(), strict=True)
    if in_the_round or course % 2 == 0:
        return list(pairs)[::-1]
    return [(not front, electrode) for front, electrode in pairs]


def words_of(stitches: Sequence[Stitch]) -> str:
    """A row in words: ``*k4, p4; rep from * to end``."""
    count = len(stitches)
    if len(set(stitches)) == 1 and not stitches[0][1]:
        return "knit" if stitches[0][0] else "purl"
    for size in range(1, count // 2 + 1):
        if count % size == 0 and list(stitches[:size]) * (count // size) == list(stitches):
            return f"*{', '.join(_brackets(_terms(stitches[:size])))}; rep from * to end"
    return ", ".join(_brackets(_terms(stitches)))


def _terms(stitches: Sequence[Stitch]) -> list[str]:
    """Runs of like stitches, such as k4 or p2 with A."""
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
    """How often a group stands next to itself."""
    group, times = terms[start : start + size], 1
    while terms[start + size * times : start + size * (times + 1)] == group:
        times += 1
    return times
