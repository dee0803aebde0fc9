"""The text of a program: its header, and that it transfers, plates and racks only where it must."""

from collections import Counter

import numpy as np

from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.program import operations
from knitlab.export.knitting.stitch_chart import stitch_chart
from tests.export.knitting.charts import case_of, chart_of_arrays
from tests.refusals import refused

CHART = stitch_chart(case_of("sensor", n_stripe=2, n_subunit=16))
MACHINE = read_machine()
PROGRAM = knitout(CHART, MACHINE)


def body():
    """Operations between the first course and the bind-off."""
    lines = PROGRAM.split("\n")
    start, end = lines.index(";course 1"), lines.index(";bind-off")
    return list(operations("\n".join(lines[start:end])))


def test_the_header_is_what_back_ends_want():
    lines = PROGRAM.split("\n")
    assert lines[0] == ";!knitout-2"
    end = next(index for index, line in enumerate(lines[1:], 1) if not line.startswith(";;"))
    assert all(lines[1:end])
    stated = dict(line[2:].split(": ", 1) for line in lines[1:end])
    assert stated["Carriers"] == "1 2 3 4 5 6 7 8 9 10"
    assert stated["Machine"] == "SWG061N2"
    assert stated["Gauge"] == "15"
    assert stated["Width"] == "360"
    assert stated["Yarn-4"].split()[0].startswith("lycra-20-dtex-silver")


def test_only_wales_that_change_their_bed_are_transferred():
    moved = Counter(operation.opcode for operation in body())["xfer"]
    assert moved == CHART.transfers + int((~CHART.front[0]).sum())


def test_every_stitch_is_knitted_once_and_plated_ones_with_two_carriers():
    knitted = [operation for operation in body() if operation.opcode == "knit"]
    assert len(knitted) == CHART.front.size
    assert Counter(len(each.carriers) for each in knitted)[2] == (CHART.plated > 0).sum()


def test_courses_go_leftwards_and_rightwards_in_turn():
    knitted = [operation for operation in body() if operation.opcode == "knit"]
    directions = np.reshape([each.direction for each in knitted], CHART.front.shape)
    assert (directions == directions[:, :1]).all()
    assert directions[:4, 0].tolist() == ["-", "+", "-", "+"]


def test_a_conductor_that_starts_rightwards_is_anchored_by_tucks_leftwards():
    chart = chart_of_arrays(np.ones((3, 6)), [[0] * 6, [0, 1, 1, 1, 0, 0], [0, 1, 1, 1, 0, 0]])
    lines = knitout(chart, MACHINE).split("\n")
    start = lines.index("inhook 4")
    assert lines[start + 1 : start + 5] == [
        "tuck - f4 4",
        "tuck - f2 4",
        "knit + f2 4 3",
        "knit + f3 4 3",
    ]
    assert lines[start + 6] == "x-stitch-number 5"
    assert lines[start + 7] == "releasehook 4"


def test_without_hooks_all_begins_rightwards_and_in_and_out_bring_yarn():
    machine = read_machine({"model": "kniterate", "waste_courses": 2})
    program = knitout(chart_of_arrays([[1, 0, 1, 1], [1, 1, 0, 1]]), machine)
    opcodes = Counter(each.opcode for each in operations(program))
    assert opcodes["in"] == opcodes["out"] == 3
    assert not [name for name in opcodes if name.endswith("hook")]
    lines = program.split("\n")
    assert lines[lines.index("in 3") + 1 :][:4] == [
        "tuck + f1 3",
        "tuck + f3 3",
        "tuck - f4 3",
        "tuck - f2 3",
    ]
    assert ";;Carriers: 1 2 3 4 5 6" in lines
    with refused("Kniterate", "one carrier", "electrodes"):
        knitout(CHART, machine)


def test_bind_off_moves_every_loop_but_the_last_onto_its_neighbour():
    lines = PROGRAM.split("\n")
    end = list(operations("\n".join(lines[lines.index(";bind-off") :])))
    assert Counter(each.opcode for each in end)["drop"] == 1
    racked = [each.parameters[0] for each in end if each.opcode == "rack"]
    assert Counter(racked) == {"-1": CHART.wales - 1, "0": CHART.wales - 1}


def test_a_dropped_sample_ends_in_waste():
    program = knitout(CHART, read_machine({"end": "drop", "waste_courses": 4}))
    assert len([each for each in operations(program) if each.opcode == "drop"]) == CHART.wales
    assert program.count("inhook 1\n") == 2


def test_a_chart_wider_than_the_machine_is_refused():
    with refused("20 needles", "SWG061N2"):
        knitout(CHART, read_machine({"needles": 20}))
