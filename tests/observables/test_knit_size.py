import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import knitlab as kl
from knitlab.model.stitches import Gauge, Stitches
from knitlab.observables.knit_size import ALONG_X, ALONG_Y, at_gauge, knit_sizes
from knitlab.runs.plan import make_plan

CLOTH = Gauge(1.35, 0.8)
FLAT = {
    "relaxed_cell_x": 3.0,
    "relaxed_cell_y": 4.0,
    "flat_cell_x": 3.0,
    "flat_cell_y": 4.0,
    "wavelength_x": 1.5,
    "wavelength_y": 1.0,
}

lengths = st.floats(0.01, 1e3)
gauges = st.builds(Gauge, lengths, lengths)
fabrics = st.fixed_dictionaries(dict.fromkeys(FLAT, lengths))
designs = st.tuples(st.integers(1, 100), st.tuples(st.integers(1, 30), st.integers(1, 30)))


def stitches(n_subunit, unit_cells=(1, 1)):
    """Of the paper's checkerboard."""
    courses, wales = 4 * n_subunit, 2 * n_subunit
    return Stitches(courses, wales, courses * unit_cells[0], wales * unit_cells[1])


def test_samples_on_360_needles_fold_to_the_width_of_the_papers():
    """About 200 mm (paper, Sec. "Kinematics under tension"), with folds at their rest angles."""
    gauge, stripes = make_plan("periodic").gauge, kl.defaults().stripes
    assert gauge == CLOTH
    for n_stripe in (2, 4, 6, 8):
        folded = 360 * gauge.stitch_width * np.sin(stripes.stripe("rib", n_stripe).theta_0 / 2)
        assert folded == pytest.approx(200, rel=0.15)


def test_without_contraction_a_cell_is_stitches_times_stitch_size():
    sizes = knit_sizes(FLAT, stitches(16, (22, 11)), False, CLOTH)
    assert sizes["knit_cell_x"] == 32 * CLOTH.stitch_width
    assert sizes["knit_cell_y"] == 64 * CLOTH.stitch_height
    assert sizes["knit_cell_x"] == pytest.approx(43.2)
    assert sizes["knit_width"] == pytest.approx(475.2)
    assert sizes["knit_wavelength_x"] == pytest.approx(sizes["knit_cell_x"] / 2)
    assert sizes["knit_wavelength_y"] == pytest.approx(sizes["knit_cell_y"] / 4)


@pytest.mark.parametrize("case", make_plan("paper").cases.values(), ids=lambda case: case.label)
def test_the_papers_samples_are_as_wide_as_360_needles(case):
    n_subunit = case.design["n_subunit"]
    assert case.stitches == stitches(n_subunit, case.unit_cells)
    width = knit_sizes(FLAT, case.stitches, False, CLOTH)["knit_width"]
    cell = 2 * n_subunit * CLOTH.stitch_width
    assert 486 - cell < width <= 486 + 1e-9


@given(fabrics, designs, gauges)
def test_a_wider_stitch_widens_and_lengthens_nothing(fabric, design, gauge):
    wider = Gauge(2 * gauge.stitch_width, gauge.stitch_height)
    before, after = (knit_sizes(fabric, stitches(*design), False, its) for its in (gauge, wider))
    assert set(before) == {*ALONG_X, *ALONG_Y}
    assert {name: after[name] for name in ALONG_X} == {name: 2 * before[name] for name in ALONG_X}
    assert {name: after[name] for name in ALONG_Y} == {name: before[name] for name in ALONG_Y}


@given(fabrics, fabrics, designs, gauges, gauges)
def test_ratios_between_designs_do_not_depend_on_the_gauge(one, other, design, gauge, another):

    def ratio(each):
        first, second = (
            knit_sizes(fabric, stitches(*design), False, each) for fabric in (one, other)
        )
        return [first[name] / second[name] for name in first]

    assert ratio(gauge) == pytest.approx(ratio(another))


@given(fabrics, designs, gauges, gauges)
def test_sizes_at_another_gauge_are_those_computed_by_it(fabric, design, gauge, another):
    before, after = (knit_sizes(fabric, stitches(*design), False, its) for its in (gauge, another))
    assert at_gauge(before, gauge, another) == pytest.approx(after)
    assert at_gauge(before, gauge, gauge) == before


def test_periodic_fabric_has_cells_but_no_size():
    sizes = knit_sizes(FLAT, stitches(16), True, CLOTH)
    assert math.isnan(sizes["knit_width"])
    assert math.isnan(sizes["knit_length"])
    assert sizes["knit_cell_x"] == 32 * CLOTH.stitch_width


def test_missing_sizes_of_the_network_are_missing_in_cloth():
    unknown = dict.fromkeys(FLAT, math.nan) | {"flat_cell_x": 3.0, "flat_cell_y": 4.0}
    assert all(map(math.isnan, knit_sizes(unknown, stitches(16, (2, 1)), False, CLOTH).values()))
    no_wave = knit_sizes(FLAT | {"wavelength_x": math.nan}, stitches(16, (2, 1)), False, CLOTH)
    assert [name for name, size in no_wave.items() if math.isnan(size)] == ["knit_wavelength_x"]
