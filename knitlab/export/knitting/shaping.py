"""How the edges of a shaped piece are knitted: decreases and increases, course by course.

Yarn is at the edge where a course begins. There stitches are bound off and needles cast on: for
this course, and for the next one, which ends at this edge. Few stitches are moved inwards instead.
"""

from typing import NamedTuple

import numpy as np

from knitlab.export.knitting.chart import StitchChart

MAX_MOVED = 2  # stitches of an edge that are moved onto others; more are bound off
OUTWARDS = np.array([-1, 1])  # steps from needle to needle, at the left and the right edge


class CourseShaping(NamedTuple):
    """What changes the edges at a course, by numbers of needles, from 1."""

    moved: list[tuple[range, int]]  # needles whose loops are moved before it, and how far
    # Outermost first. Needles of this course are bound off with its stitches, others before it.
    bound_off: range
    cast_on: range  # innermost first, for this course
    cast_on_ahead: range  # for the next course


def shaping(chart: StitchChart, first_direction: int, largest_racking: int) -> list[CourseShaping]:
    """The shaping of each course of a chart.

    Courses go to and fro, the first leftwards (``first_direction`` -1) or rightwards (1).
    """
    starts, stops = chart.edges.T
    ends = np.stack([starts + 1, stops], axis=1)  # outermost needles of (course, edge)
    growth = np.zeros((chart.courses + 1, 2), int)
    growth[1:-1] = np.diff(ends, axis=0) * OUTWARDS
    kept = np.minimum(stops[1:], stops[:-1]) - np.maximum(starts[1:], starts[:-1])
    lost = np.maximum(-growth, 0)
    is_bound = lost > min(MAX_MOVED, largest_racking)
    is_bound[1:-1] |= (lost[1:-1].sum(axis=1) > kept)[:, None] & (lost[1:-1] > 0)
    shaped = []
    for course in range(chart.courses):
        edge = int(first_direction * (-1) ** course < 0)  # where it begins
        out = int(OUTWARDS[edge])
        before, here, after = (int(ends[k, edge]) for k in _around(course, chart.courses))
        grows, will_grow = growth[course : course + 2, edge] > 0
        binds, will_bind = is_bound[course : course + 2, edge]
        moved = [
            (range(int(ends[course - 1, each]), int(ends[course, each]), -step), step * -int(count))
            for each, (step, count) in enumerate(zip(OUTWARDS.tolist(), lost[course], strict=True))
            if count and not is_bound[course, each]
        ]
        shaped.append(
            CourseShaping(
                moved,
                range(before if binds else here, after if will_bind else here, -out),
                range(before + out, here + out, out) if grows else range(0),
                range(here + out, after + out, out) if will_grow else range(0),
            )
        )
    return shaped


def _around(course: int, courses: int) -> tuple[int, int, int]:
    return max(course - 1, 0), course, min(course + 1, courses - 1)
