"""Shaped pieces: a program knits their stitches and edges, by the check and the interpreter."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from knitlab.export.knitting.chart_files import read_stitches
from knitlab.export.knitting.checks import check
from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.program import operations
from knitlab.export.knitting.round_trip import interpreted, round_trip
from knitlab.export.knitting.specification import Specification
from knitlab.model.stitches import Gauge
from tests.export.knitting.charts import chart_of_arrays, fast_protocols  # noqa: F401
from tests.export.knitting.test_round_trip import interpreter, kniterates, machines, own_reading
from tests.refusals import refused

MACHINE = read_machine({"waste_courses": 2})


def shaped(spans, front=None):
    """A chart of 2 × 2 rib, or other stitches, with an outline."""
    spans = np.array(spans)
    courses, wales = len(spans), spans.max()
    rib = np.tile(np.arange(wales) // 2 % 2 == 0, (courses, 1))
    return replace(chart_of_arrays(rib if front is None else front), spans=spans)


COURSE = np.arange(12)
PIECES = {
    "rectangle": [[0, 12]] * 6,
    "trapezoid": [[k // 2, 20 - k // 2] for k in range(10)],
    "bulge": np.stack([np.abs(COURSE - 6), 18 - np.abs(COURSE - 6)], axis=1),
    "step in": [[0, 32]] * 4 + [[0, 16]] * 4,
    "step out": [[16, 32]] * 4 + [[0, 32]] * 4,
    "steps both ways": [[8, 20]] * 3 + [[0, 28]] * 3 + [[12, 16]] * 3 + [[0, 28]] * 3,
    "to a point": [[0, 5], [1, 4], [2, 3], [2, 3]],
    "zigzag": [[0, 9], [5, 9], [0, 9], [0, 4], [1, 9], [0, 9]],
}


@st.composite
def pieces(draw):
    """Charts of any stitches and outline."""
    courses, wales = draw(st.integers(1, 8)), draw(st.integers(2, 9))
    spans = []
    for _ in range(courses):
        start = draw(st.integers(0, min(wales, *[b for _, b in spans[-1:]], wales) - 1))
        lowest = max([a for a, _ in spans[-1:]] + [start])
        spans.append((start, draw(st.integers(lowest + 1, wales))))
    cells = draw(st.lists(st.booleans(), min_size=courses * wales, max_size=courses * wales))
    return shaped(np.array(spans), np.reshape(cells, (courses, wales)))


@given(pieces(), machines | kniterates)
def test_any_piece_is_knitted_without_a_mistake_and_read_back_as_it_was(chart, machine):
    _, stitches = own_reading(knitout(chart, machine), chart, machine)
    assert chart.difference(stitches) is None


@pytest.mark.slow
@interpreter
@pytest.mark.parametrize("name", ["rectangle", "trapezoid", "bulge", "step in"])
def test_the_interpreter_knits_the_same_piece(name, fast_protocols):  # noqa: F811
    chart = shaped(PIECES[name])
    program = knitout(chart, MACHINE)
    assert round_trip(program, chart, MACHINE, interpret=True).mistakes == ()
    assert interpreted(program) == check(program, MACHINE)[1]


@interpreter
@pytest.mark.slow
@given(pieces(), machines)
@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_the_interpreter_knits_any_piece(chart, machine):
    program = knitout(chart, machine)
    assert interpreted(program) == check(program, machine)[1]


def test_a_chart_whose_courses_have_all_wales_is_knitted_as_one_without_spans():
    chart = shaped(PIECES["rectangle"])
    assert knitout(chart, MACHINE) == knitout(replace(chart, spans=None), MACHINE)


def body_opcodes(spans):
    program = knitout(shaped(spans), MACHINE)
    body = program[program.index(";course 1") : program.index(";bind-off")]
    return Counter(each.opcode for each in operations(body))


def test_few_stitches_are_moved_inwards_and_many_bound_off():
    rib = Counter(body_opcodes([[0, 32]] * 4))
    narrowing = body_opcodes([[0, 32], [1, 31], [3, 29], [3, 29]]) - rib
    assert narrowing.keys() == {"xfer", "rack"}
    # At one edge with the last stitches of the course before, at the other with one more each.
    for spans, more in (([[0, 32]] * 2 + [[0, 16]] * 2, 16), ([[0, 32]] * 2 + [[16, 32]] * 2, 0)):
        assert body_opcodes(spans)["knit"] == np.ptp(spans, axis=1).sum() + more


def other_outlines(spans):
    """An outline with one edge of one course moved by a wale, in each way that is possible."""
    for course, edge in np.ndindex(spans.shape):
        for shift in (-1, 1):
            other = spans.copy()
            other[course, edge] += shift
            starts, stops = other[max(course - 1, 0) : course + 2].T
            if starts.max() < stops.min() and other.min() >= 0 and other.max() <= spans.max():
                yield other


def knitted_lines(program):
    return [line for line in program.splitlines() if line.startswith(("knit", "xfer", "drop"))]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["trapezoid", "steps both ways", "to a point", "zigzag"])
def test_every_edge_at_another_wale_is_found(name):
    chart = shaped(PIECES[name])
    own = knitted_lines(knitout(chart, MACHINE))
    for spans in other_outlines(chart.spans):
        program = knitout(replace(chart, spans=spans), MACHINE)
        mistakes = round_trip(program, chart, MACHINE, interpret=False).mistakes
        # A bind-off's chain and the row that closes a cast-on may as well be stitches of a chart.
        is_same = name != "trapezoid" and knitted_lines(program) == own
        assert is_same or mistakes, spans


TRAPEZOID = shaped(PIECES["trapezoid"])
PROGRAM = knitout(TRAPEZOID, MACHINE)
SEEDED = {
    "edge not moved": ("xfer f1 b1\nrack 1\nxfer b1 f2\nrack 0\n", "", "f1"),
    "edge dropped": ("xfer f1 b1\nrack 1\nxfer b1 f2\nrack 0\n", "drop f1\n", "drop f1"),
    "edge moved to another wale": (
        "xfer f1 b1\nrack 1\nxfer b1 f2\n",
        "rack -2\nxfer f1 b3\n",
        "wale 1 is not joined to wale 2",
    ),
    "needle without a loop moved": ("xfer b1 f2\n", "xfer b1 f2\nxfer b2 f3\n", "b2 holds no loop"),
}


@pytest.mark.parametrize("name", SEEDED)
def test_a_loop_that_is_lost_or_moved_elsewhere_is_found(name):
    before, after, words = SEEDED[name]
    start = PROGRAM.index(";course 3")
    program = PROGRAM[:start] + PROGRAM[start:].replace(before, after, 1)
    assert program != PROGRAM
    mistakes = round_trip(program, TRAPEZOID, MACHINE, interpret=False).mistakes
    assert any(words in each for each in mistakes), mistakes


@pytest.mark.parametrize("joined", [3, 4])
def test_a_needle_holds_at_most_three_loops(joined):
    lines = [f"tuck - f{number} 3" for number in range(joined, 0, -1)]
    for number in range(1, joined):
        shift = joined - number
        lines += [f"xfer f{number} b{number}", f"rack {shift}", f"xfer b{number} f{joined}"]
        lines += ["rack 0"]
    header = PROGRAM[: PROGRAM.index("x-speed")]
    program = "\n".join([header, "inhook 3", *lines, "releasehook 3", "outhook 3"])
    mistakes = [str(each) for each in check(program, MACHINE)[0]]
    assert any("already holds a loop" in each for each in mistakes) == (joined > 3)


def test_a_plated_piece_is_refused():
    plated = np.zeros(TRAPEZOID.front.shape, int)
    plated[:, 10] = 1
    with refused("plated", "shaped", "electrodes"):
        knitout(replace(TRAPEZOID, plated=plated), MACHINE)


@pytest.mark.parametrize("name", [name for name in PIECES if name != "rectangle"])
def test_a_piece_has_no_pattern(name, tmp_path):
    chart = shaped(PIECES[name])
    for suffix, text in ((".csv", chart.table()), (".k", knitout(chart, MACHINE))):
        path = tmp_path / f"piece{suffix}"
        path.write_text(text, encoding="utf-8")
        with refused("piece", "only a rectangle"):
            read_stitches(path)


def test_absent_stitches_are_empty_cells_and_not_counted():
    spans = [[0, 4], [1, 4], [1, 3]]
    chart = shaped(spans, [[1, 1, 0, 0], [1, 0, 0, 0], [0, 1, 0, 1]])
    assert chart.table().splitlines()[1:] == ["3,,k,p,", "2,,p,p,p", "1,k,k,p,p"]
    assert chart.transfers == 2
    sheet = Specification(chart, MACHINE, Gauge(1.0, 0.5), knitout(chart, MACHINE))
    rows = dict(sheet.rows())
    assert rows["stitches"] == "9, 6 on the back bed"
    assert rows["shape"] == "2 to 4 wales a course"
    assert sheet.flat_size == (4, 1.5)
    assert sheet.duration.passes["knit"] > chart.courses
