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
    outermost = chart.edges + np.array([1, 0])  # needles at the left and the right
    ends = np.pad(outermost, ((1, 1), (0, 0)), "edge")  # also before the first course
    growth = np.diff(ends, axis=0) * OUTWARDS  # of (course, edge) against the course before
    lost = np.maximum(-growth, 0)
    kept = 1 + np.minimum(ends[1:, 1], ends[:-1, 1]) - np.maximum(ends[1:, 0], ends[:-1, 0])
    fits = lost.sum(axis=1, keepdims=True) <= kept[:, None]
    is_moved = (lost > 0) & (lost <= min(MAX_MOVED, largest_racking)) & fits
    is_bound = (lost > 0) & ~is_moved
    shaped = []
    for course in range(chart.courses):
        moved = []
        for edge in np.flatnonzero(is_moved[course]).tolist():
            inwards = -int(OUTWARDS[edge])
            old, new = ends[course : course + 2, edge].tolist()
            needles = range(old, new, inwards)
            moved.append((needles, inwards * len(needles)))
        edge = int(first_direction * (-1) ** course < 0)  # where it begins
        out = int(OUTWARDS[edge])
        before, here, after = ends[course : course + 3, edge].tolist()
        binds, will_bind = is_bound[course : course + 2, edge]
        grows, will_grow = growth[course : course + 2, edge] > 0
        shaped.append(
            CourseShaping(
                moved,
                range(before if binds else here, after if will_bind else here, -out),
                range(before + out, here + out, out) if grows else range(0),
                range(here + out, after + out, out) if will_grow else range(0),
            )
        )
    return shaped
