"""The checks find faults that are seeded into a program, each on its line."""

import re

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
FAULTS = {
    "conductor first used with the body": (
        replaced("tuck - b2 4"),
        r"knit - b2 3 4: the first stitch of carrier 4 has others too, which knitout",
    ),
    "no width": (
        replaced(";;Width: 360", after=LINES[0]),
        r"header: is not ;;Width: 360; write that, as Position: Center means the middle of another",
    ),
    "list of other carriers": (
        replaced(";;Carriers: 1 2 3 4 5 6 7 8 9 10", ";;Carriers: 1 2 3", after=LINES[0]),
        r"line 9: ;;Carriers: 1 2 3: knitout-to-dat.js takes ;;Carriers: 1 2 3 4 5 6 7 8 9 10",
    ),
    "no first line": (
        replaced(";!knitout-2", ";", after=LINES[0]),
        r"line 1: ;: is not ;!knitout-2",
    ),
    "carrier that the machine lacks": (
        replaced("inhook 4", "inhook 11"),
        r"the machine has 10 carriers; name one of them",
    ),
    "operations of another machine": (
        replaced("inhook 4", "in 4"),
        r"in 4: knitout-to-dat.js is for inhook and outhook alone; write these",
    ),
    "needle out of range": (
        replaced("knit - f1 3", "knit - f361 3"),
        r"f361 is outside the needles 1 to 360",
    ),
    "transfer forgotten": (
        replaced("xfer f2 b2", after=TURN),
        r"f2 holds a loop of this wale, too; transfer it before",
    ),
    "every course transferred": (
        replaced(TURN, TURN, "xfer b1 f1"),
        r"xfer b1 f1: b1 holds no loop; transfer only where the bed changes",
    ),
    "transfer onto another loop": (
        replaced(TURN, TURN, "rack 1", "xfer b2 f3", "rack 0", "xfer b3 f3"),
        r"f3|b2 holds no loop",
    ),
    "transfer askew": (
        replaced("xfer f2 b2", "xfer f2 b3", after=TURN),
        r"f2 is opposite b2 at racking 0; rack before",
    ),
    "stitch dropped": (
        replaced(TURN, TURN, "drop f1"),
        r"drops a loop of carrier 3, which goes on, so that the wale runs",
    ),
    "wale on both beds": (
        replaced("knit - f2 3", "knit - f2 3", "tuck - b2 3"),
        r"holds a loop of this wale, too; transfer it before knitting here",
    ),
    "needle filled": (
        replaced("knit - f2 3", "knit - f2 3", "tuck - f2 3", "tuck - f2 3"),
        r"tuck - f2 3: f2 holds 2 loops already; knit them first",
    ),
    "carrier not brought in": (
        replaced("inhook 3", after=";cast-on"),
        r"carrier 3 is not in action; bring it in by inhook 3",
    ),
    "carrier not taken out": (
        replaced("outhook 4"),
        r"ends while carrier 4 is in action; add outhook 4",
    ),
    "carrier used after it was taken out": (
        replaced("knit + f1 3", "outhook 3", "knit + f1 3"),
        r"carrier 3 is not in action",
    ),
    "hook not released": (
        replaced("releasehook 3", after=";cast-on"),
        r"hook (still|with|holds)|ends while the hook holds carrier 3|inserting hook",
    ),
    "hook released twice": (
        replaced(TURN, TURN, "releasehook 3"),
        r"the hook does not hold carrier 3; take the line out",
    ),
    "carrier brought in rightwards": (
        replaced("inhook 4", "inhook 4", "tuck + b2 4"),
        r"the first stitch of carrier 4 goes rightwards",
    ),
    "conductor alone": (
        replaced("knit - b2 3 4", "knit - b2 4"),
        r"knits a conductor alone; plate it with the body's carrier 3",
    ),
    "conductors joined": (
        replaced("knit - b2 3 4", "inhook 5", "knit - b2 5 4"),
        r"joins the conductors of two electrodes",
    ),
    "three carriers": (
        replaced("knit - b2 3 4", "knit - b2 3 4 1"),
        r"has 3 carriers; take at most 2",
    ),
    "loops left": (
        replaced("drop f1", after=";bind-off"),
        r"ends while f1 hold loops|ends while f1",
    ),
    "racked too far": (
        replaced("rack -1", "rack -5", after=";bind-off"),
        r"racks by more than 4 needles",
    ),
}


def test_the_program_itself_has_no_fault():
    assert check(PROGRAM, MACHINE)[0] == []


def test_of_a_machine_without_hooks_the_first_stitch_goes_rightwards_and_has_one_yarn():
    machine = read_machine({"model": "Kniterate", "waste_courses": 0})
    header = ";!knitout-2\n;;Width: 252\n;;Carriers: 1 2 3 4 5 6\n"
    tucks = "in 3\ntuck - f1 3\nknit + f1 3 4\nout 3\ndrop f1\n"
    mistakes = list(map(str, check(header + tucks, machine)[0]))
    assert mistakes[0].startswith(
        "line 5: tuck - f1 3: the first stitch of carrier 3 goes leftwards"
    )
    assert "line 6: knit + f1 3 4: has 2 carriers; take at most 1" in mistakes


@pytest.mark.parametrize("name", FAULTS)
def test_a_seeded_fault_is_found(name):
    (program, _), message = FAULTS[name]
    mistakes = [str(fault) for fault in check(program, MACHINE)[0]]
    assert any(re.search(message, text) for text in mistakes), mistakes


@pytest.mark.parametrize(
    "name",
    ["needle out of range", "every course transferred", "needle filled", "conductor alone"],
)
def test_a_finding_names_the_line_of_its_fault(name):
    (program, line), message = FAULTS[name]
    added = 2 if name == "needle filled" else 1 if name == "every course transferred" else 0
    first = check(program, MACHINE)[0][0]
    assert re.search(message, str(first))
    assert first.path == f"line {line + added}: {program.split(chr(10))[line + added - 1]}"


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (replaced("knit - f1 3", after=";course 3"), "wale 1 has 3 stitches, not 4"),
        (replaced("knit - b2 3 4", "knit - b2 4 3"), "conductor on the back, not a back knit of"),
        (replaced("knit - b2 3 4", "knit - b2 3"), "course 3, wale 2 is a back knit, not a back"),
        (
            replaced("knit + f1 3", "xfer f1 b1", "knit + b1 3", "xfer b1 f1"),
            r"course 2, wale 1 is a back knit, not a front knit",
        ),
    ],
    ids=["stitch left out", "face of the conductor", "not plated", "wrong bed"],
)
def test_a_program_that_only_knits_another_chart_is_reported(fault, message):
    mistakes = round_trip(fault[0], CHART, MACHINE, interpret=False).mistakes
    assert any(re.search(message, text) for text in mistakes), mistakes
