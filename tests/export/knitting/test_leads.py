"""Lead-outs: the ends of the yarn of each electrode, as a program brings it in and takes it out."""

import numpy as np
import pytest

from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.leads import leads
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.program import operations
from knitlab.export.knitting.stitch_chart import stitch_chart
from tests.export.knitting.charts import case_of, chart_of_arrays

MACHINE = read_machine({"waste_courses": 2})


def leads_of(chart):
    return leads(knitout(chart, MACHINE), chart, MACHINE)


@pytest.mark.parametrize("repeats", [(1, 1), (2, 3)])
def test_conductors_along_wales_leave_at_the_lower_and_the_upper_edge(repeats):
    chart = stitch_chart(case_of("sensor", n_stripe=2, n_subunit=16), repeats)
    found = leads_of(chart)
    ends = [(each.electrode, each.enters) for each in found]
    assert ends == [(1, True), (1, False), (2, True), (2, False)]
    for each in found:
        assert each.course == (0 if each.enters else chart.courses - 1)
        assert chart.plated[each.course, each.wale] == each.electrode
        assert (each.edge, each.distance) == ("lower" if each.enters else "upper", 0)


def test_ends_are_where_the_program_brings_a_carrier_in_and_out():
    plated = np.zeros((6, 9), int)
    plated[1:4, 3:6], plated[2:6, 7:] = 1, 2
    chart = chart_of_arrays(np.ones((6, 9)), plated)
    program = list(operations(knitout(chart, MACHINE)))
    for electrode in (1, 2):
        carrier = str(MACHINE.carrier_of(electrode))
        wales = [
            each.needles[0].number - 1
            for each in program
            if each.opcode in ("knit", "tuck") and carrier in each.carriers
        ]
        first, last = (each for each in leads_of(chart) if each.electrode == electrode)
        assert (first.wale, last.wale) == (wales[0], wales[-1])
        courses = np.flatnonzero((plated == electrode).any(axis=1))
        assert (first.course, last.course) == (courses[0], courses[-1])


def test_an_end_inside_goes_to_the_nearest_edge_that_the_other_electrode_leaves_free():
    plated = np.zeros((9, 9), int)
    plated[4, 3] = 1
    plated[3:6, 1] = 2  # between A and the left edge
    found = leads_of(chart_of_arrays(np.ones((9, 9)), plated))
    # Four courses are below and above, five wales to the right.
    assert all((each.edge, each.distance) == ("lower", 4) for each in found[:2])
    assert all("inside, 4 stitches from the lower edge" in str(each) for each in found[:2])
    assert all((each.edge, each.distance) == ("left", 1) for each in found[2:])
