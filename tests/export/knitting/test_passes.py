"""Carriage passes: counted by hand, and their time by the speeds."""

import numpy as np
import pytest

from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.program import carriage_passes, duration, longest_floats, operations
from knitlab.export.knitting.specification import Specification
from knitlab.model.stitches import Gauge
from tests.export.knitting.charts import chart_of_arrays

TEXT = """inhook 3
knit - f3 3
knit - b2 3
knit - f1 3
xfer f1 b1
xfer f3 b3
xfer b2 f2
knit + b1 3
x-stitch-number 6
knit + f2 3 4
x-stitch-number 5
knit + b3 3
rack 1
outhook 3
"""


def specification_of(chart):
    machine = read_machine()
    return Specification(chart, machine, Gauge(0.5, 0.25), knitout(chart, machine))


def test_passes_of_a_program():
    passes = list(carriage_passes(operations(TEXT)))
    assert [(each.kind, each.first, each.last) for each in passes] == [
        ("knit", 3, 1),
        ("transfer", 1, 3),
        ("transfer", 2, 2),
        ("knit", 1, 1),
        ("knit", 2, 2),
        ("knit", 3, 3),
    ]


def test_the_time_of_a_program_is_that_of_its_parts():
    machine = read_machine()
    spent, metres = duration(operations(TEXT), machine), machine.pitch / 1000
    assert spent.passes == {"knit": 4, "transfer": 2, "empty": 2, "drop": 0}
    assert spent.seconds == pytest.approx(
        8 * machine.turn_time
        + metres * (3 + 1 + 1 + 1 + 2 * 1) / machine.knitting_speed
        + metres * (3 + 1) / machine.transfer_speed
        + machine.racking_time
        + 2 * machine.carrier_time
    )


def test_floats_pass_the_needles_between_two_stitches_of_a_yarn():
    text = "inhook 3\nknit - f9 3\nknit - f8 3\nknit - f2 3\nknit + f2 3\n"
    assert longest_floats(operations(text)) == {"3": 5}


def test_every_group_of_a_plated_course_takes_a_pass_of_its_own():
    plated = np.zeros((10, 20), int)
    plated[:, 5:8], plated[:, 12:14] = 1, 2
    sheet = specification_of(chart_of_arrays(np.ones((10, 20)), plated))
    # Five passes in place of one, all in one direction, with four empty ones between.
    # Each conductor's anchor takes one more, from which the carriage comes back.
    for kind in ("knit", "empty"):
        assert sheet.duration.passes[kind] - sheet.unplated.passes[kind] == 10 * 4 + 2
    assert sheet.flat_size == (10, 2.5)
    assert sheet.relaxed_size is None
