"""A program knits the chart that it was written from, by knitlab's check and by the interpreter."""

import importlib
import importlib.util
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import knitlab as kl
from knitlab.export.knitting.checks import check
from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.round_trip import (
    MAX_OPERATIONS,
    chart_stitches,
    interpreted,
    round_trip,
    stripped,
)
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.runs.patterns import Pattern
from tests.export.knitting.back_ends import assert_knits, read_dat, read_kcode
from tests.export.knitting.charts import case_of, chart_of_arrays, fast_protocols  # noqa: F401

interpreter = pytest.mark.skipif(
    importlib.util.find_spec("knitout_interpreter") is None, reason="no knitout-interpreter"
)
PAPER = kl.defaults().designs.root["paper"].pairs
GRADED = Pattern(
    rows=("GRP", "RGR"),
    column_stitches=(8, 16, 24),
    column_n_stripe=(2, 4, 6),
    row_courses=(32, 16),
    row_n_stripe=(4, 2),
)
"""Columns and rows that differ in size and in their stripes."""
ENDS = ["bind_off", "drop"]

ROUND_TRIP = importlib.import_module("knitlab.export.knitting.round_trip")


@st.composite
def charts(draw):
    """Charts of any stitches, plated anywhere."""
    courses, wales = draw(st.integers(1, 7)), draw(st.integers(2, 8))
    cells = courses * wales
    front = draw(st.lists(st.booleans(), min_size=cells, max_size=cells))
    plated = draw(st.lists(st.sampled_from([0, 0, 1, 2]), min_size=cells, max_size=cells))
    faces = draw(st.tuples(*[st.sampled_from(["front", "back"])] * 2))
    shape = courses, wales
    return chart_of_arrays(np.reshape(front, shape), np.reshape(plated, shape), faces)


machines = st.fixed_dictionaries(
    {
        "end": st.sampled_from(ENDS),
        "waste_courses": st.sampled_from([0, 2]),
        "setup_courses": st.sampled_from([2, 4]),
        "plating": st.sampled_from(["face_first", "reverse_first"]),
    }
).map(read_machine)


kniterates = st.fixed_dictionaries(
    {
        "model": st.just("Kniterate"),
        "end": st.sampled_from(ENDS),
        "waste_courses": st.sampled_from([0, 2]),
    }
).map(read_machine)


def own_reading(program, chart, machine):
    mistakes, graph = check(program, machine)
    assert mistakes == []
    return graph, chart_stitches(graph, chart, machine)


@given(charts(), machines | kniterates)
def test_any_chart_is_knitted_without_a_mistake_and_read_back_as_it_was(chart, machine):
    chart = chart if machine.hooks else chart_of_arrays(chart.front)
    _, stitches = own_reading(knitout(chart, machine), chart, machine)
    assert chart.difference(stitches) is None


@interpreter
@pytest.mark.slow
@given(charts(), machines)
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_the_interpreter_builds_the_same_knit_graph_of_any_chart(chart, machine):
    program = knitout(chart, machine)
    graph, _ = own_reading(program, chart, machine)
    assert interpreted(program) == list(graph)


@interpreter
@pytest.mark.parametrize("end", ENDS)
def test_the_interpreter_knits_a_small_plated_chart(end, fast_protocols):  # noqa: F811
    case = case_of("sensor", n_stripe=2, n_subunit=16)
    chart, machine = stitch_chart(case), read_machine({"end": end, "waste_courses": 2})
    chart = chart_of_arrays(chart.front[:10, :16], chart.plated[:10, :16], chart.plated_face)
    checked = round_trip(knitout(chart, machine), chart, machine, interpret=True)
    assert checked.mistakes == ()
    assert [note.partition(":")[0] for note in checked.notes] == ["own checks", "interpreter"]


BACK_ENDS = os.environ.get("KNITOUT_BACK_ENDS")  # folder with the back ends' scripts


@pytest.mark.slow
@pytest.mark.parametrize("design", PAPER[::5], ids=str)
def test_back_ends_convert_programs_to_the_same_chart(design, tmp_path):
    """By the back ends themselves where Node and their scripts are at hand, else by the check."""
    sizes = {"n_stripe": design[0], "n_subunit": design[1]}
    plain, plated = (stitch_chart(case_of(name, **sizes)) for name in ("periodic", "sensor"))
    for chart, model in ((plain, "SWG061N2"), (plated, "SWG061N2"), (plain, "Kniterate")):
        machine = read_machine({"model": model})
        program, converted = tmp_path / "sample.k", tmp_path / "sample.out"
        program.write_text(knitout(chart, machine), encoding="utf-8")
        assert round_trip(program.read_text(), chart, machine, interpret=False).mistakes == ()
        if BACK_ENDS is None:
            continue
        call = ["node", Path(BACK_ENDS, machine.back_end), program, converted]
        done = subprocess.run(call, capture_output=True, text=True, check=True)
        assert "ssertion" not in done.stdout + done.stderr
        body = machine.body_carrier
        if machine.hooks:
            stitches = read_dat(converted.read_bytes(), chart.wales, body)
        else:
            stitches = read_kcode(converted.read_text(), body)
        assert_knits(stitches, chart, machine)


@interpreter
@pytest.mark.slow
@pytest.mark.timeout(3600)  # 80,000 operations, each a millisecond or two
# The larger ones take a quarter of an hour in all, and differ in size alone.
@pytest.mark.parametrize("design", [(2, 16), (4, 16), (4, 32), (6, 24), (8, 32)], ids=str)
def test_the_interpreter_knits_designs_of_every_stripe(design, fast_protocols):  # noqa: F811
    chart = stitch_chart(case_of(n_stripe=design[0], n_subunit=design[1]))
    machine = read_machine({"waste_courses": 2, "end": "drop"})
    assert round_trip(knitout(chart, machine), chart, machine, interpret=True).mistakes == ()


@interpreter
@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        pytest.param({"workflow": "sensor", "n_stripe": 4, "n_subunit": 16}, id="plated"),
        pytest.param({"workflow": "sensor_stripes", "knit": ["rib"]}, id="plated rib"),
        pytest.param({"n_stripe": 4, "n_subunit": 16, "pattern": GRADED}, id="graded"),
        pytest.param({"n_stripe": 2, "n_subunit": 8, "pattern": "framed"}, id="plain knit"),
    ],
)
def test_the_interpreter_knits_graded_plain_and_plated_fabric(case, fast_protocols):  # noqa: F811
    graded = case.get("pattern") is GRADED
    chart = kl.knit(kl.Design(**case)).chart if graded else stitch_chart(case_of(**case))
    machine = read_machine()
    assert round_trip(knitout(chart, machine), chart, machine, interpret=True).mistakes == ()


def test_the_copy_for_the_interpreter_keeps_the_number_of_every_line():
    chart, machine = chart_of_arrays(np.ones((2, 3))), read_machine()
    program = knitout(chart, machine)
    original, copy = program.split("\n"), stripped(program).split("\n")
    assert len(original) == len(copy)
    assert copy[original.index("inhook 3")] == "inhook 3"
    assert not [line for line in copy if line.startswith(("x-", ";;Yarn", ";;X-"))]
    assert ";;Machine: SWG091N2" in copy


def test_the_interpreter_is_not_asked_of_long_programs(monkeypatch):
    monkeypatch.setattr(ROUND_TRIP, "MAX_OPERATIONS", 10)
    assert MAX_OPERATIONS > 10
    monkeypatch.setattr(ROUND_TRIP, "find_spec", lambda name: True)
    chart, machine = chart_of_arrays(np.ones((2, 3))), read_machine()
    checked = round_trip(knitout(chart, machine), chart, machine)
    assert checked.notes[1].startswith("interpreter: not run,")
