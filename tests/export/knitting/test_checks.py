"""The checks find mistakes that are seeded into a program, each on its line."""

import pytest

from knitlab.export.knitting.checks import check
from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.round_trip import round_trip
from tests.export.knitting.charts import chart_of_arrays

# Four wales of rib; the third course turns the second wale over, and A is plated from there on.
CHART = chart_of_arrays(
    [[1, 1, 0, 0], [1, 1, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]],
    [[0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]],
)
MACHINE = read_machine({"waste_courses": 2})
PROGRAM = knitout(CHART, MACHINE)
LINES = PROGRAM.split("\n")


def line_of(operation, after=";course 1"):
    """Index of the first line with an operation after another line."""
    return LINES.index(operation, LINES.index(after))


def replaced(operation, *others, after=";course 1"):
    """The program with other lines in place of one."""
    index = line_of(operation, after)
    return "\n".join([*LINES[:index], *others, *LINES[index + 1 :]]), index + 1


TURN = ";course 3"
SEEDED = {
    "conductor first used with the body": (replaced("tuck - b2 4"), "knit - b2 3 4"),
    "no width": (replaced(";;Width: 360", after=LINES[0]), "header: is not ;;Width: 360"),
    "list of other carriers": (
        replaced(";;Carriers: 1 2 3 4 5 6 7 8 9 10", ";;Carriers: 1 2 3", after=LINES[0]),
        "line 9: ;;Carriers: 1 2 3",
    ),
    "no first line": (replaced(";!knitout-2", ";", after=LINES[0]), ";!knitout-2"),
    "carrier that the machine lacks": (replaced("inhook 4", "inhook 11"), "10 carriers"),
    "operations of another machine": (replaced("inhook 4", "in 4"), "inhook and outhook"),
    "needle out of range": (replaced("knit - f1 3", "knit - f361 3"), "needles 1 to 360"),
    "transfer forgotten": (replaced("xfer f2 b2", after=TURN), "f2 holds a loop"),
    "every course transferred": (replaced(TURN, TURN, "xfer b1 f1"), "b1 holds no loop"),
    "transfer onto another loop": (
        replaced(TURN, TURN, "rack 1", "xfer b2 f3", "rack 0", "xfer b3 f3"),
        "b2 holds no loop",
    ),
    "transfer askew": (replaced("xfer f2 b2", "xfer f2 b3", after=TURN), "f2 is opposite b2"),
    "stitch dropped": (replaced(TURN, TURN, "drop f1"), "loop of carrier 3"),
    "wale on both beds": (replaced("knit - f2 3", "knit - f2 3", "tuck - b2 3"), "of this wale"),
    "needle filled": (
        replaced("knit - f2 3", "knit - f2 3", "tuck - f2 3", "tuck - f2 3"),
        "f2 holds 2 loops",
    ),
    "carrier not brought in": (replaced("inhook 3", after=";cast-on"), "inhook 3"),
    "carrier not taken out": (replaced("outhook 4"), "add outhook 4"),
    "carrier used after it was taken out": (
        replaced("knit + f1 3", "outhook 3", "knit + f1 3"),
        "carrier 3 is not in action",
    ),
    "hook not released": (replaced("releasehook 3", after=";cast-on"), "hook"),
    "hook released twice": (replaced(TURN, TURN, "releasehook 3"), "does not hold carrier 3"),
    "carrier brought in rightwards": (replaced("inhook 4", "inhook 4", "tuck + b2 4"), "rightward"),
    "conductor alone": (replaced("knit - b2 3 4", "knit - b2 4"), "body's carrier 3"),
    "conductors joined": (replaced("knit - b2 3 4", "inhook 5", "knit - b2 5 4"), "two electrodes"),
    "three carriers": (replaced("knit - b2 3 4", "knit - b2 3 4 1"), "3 carriers"),
    "loops left": (replaced("drop f1", after=";bind-off"), "ends while f1"),
    "racked too far": (replaced("rack -1", "rack -5", after=";bind-off"), "more than 4 needles"),
}
"""Programs with one mistake each, with its line, and words of the message."""


def test_the_program_itself_has_no_mistake():
    assert check(PROGRAM, MACHINE)[0] == []


def test_of_a_machine_without_hooks_the_first_stitch_goes_rightwards_and_has_one_yarn():
    machine = read_machine({"model": "Kniterate", "waste_courses": 0})
    header = ";!knitout-2\n;;Width: 252\n;;Carriers: 1 2 3 4 5 6\n"
    tucks = "in 3\ntuck - f1 3\nknit + f1 3 4\nout 3\ndrop f1\n"
    first, *others = map(str, check(header + tucks, machine)[0])
    assert first.startswith("line 5: tuck - f1 3")
    assert "leftwards" in first
    assert any("line 6" in each and "2 carriers" in each for each in others)


@pytest.mark.parametrize("name", SEEDED)
def test_a_seeded_mistake_is_found(name):
    (program, _), words = SEEDED[name]
    mistakes = [str(mistake) for mistake in check(program, MACHINE)[0]]
    assert any(words in text for text in mistakes), mistakes


@pytest.mark.parametrize(
    ("name", "after"),
    [
        ("needle out of range", 0),
        ("every course transferred", 1),
        ("needle filled", 2),
        ("conductor alone", 0),
    ],
)
def test_a_mistake_names_its_line(name, after):
    (program, line), words = SEEDED[name]
    first = check(program, MACHINE)[0][0]
    assert words in str(first)
    assert first.path == f"line {line + after}: {program.split(chr(10))[line + after - 1]}"


@pytest.mark.parametrize(
    ("seeded", "words"),
    [
        (replaced("knit - f1 3", after=";course 3"), "wale 1 has 3 stitches"),
        (replaced("knit - b2 3 4", "knit - b2 4 3"), "conductor on the back"),
        (replaced("knit - b2 3 4", "knit - b2 3"), "course 3, wale 2"),
        (replaced("knit + f1 3", "xfer f1 b1", "knit + b1 3", "xfer b1 f1"), "course 2, wale 1"),
    ],
    ids=["stitch left out", "face of the conductor", "not plated", "wrong bed"],
)
def test_a_program_that_only_knits_another_chart_is_reported(seeded, words):
    mistakes = round_trip(seeded[0], CHART, MACHINE, interpret=False).mistakes
    assert any(words in text for text in mistakes), mistakes
