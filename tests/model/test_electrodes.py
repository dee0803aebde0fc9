"""Layouts of electrodes: their position on the chart, and refused layouts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.electrodes import (
    BadLayout,
    ElectrodeLayout,
    Electrodes,
    Strip,
    place_electrodes,
    ridge_lines,
    split_by_cells,
)
from knitlab.model.network import MeshShape
from knitlab.model.settings import ModelOptions
from tests.fabrics import CLAMPED, PERIODIC, checkerboard, patch_map


def stitches(pattern):
    """Courses and wales in the grid cells of n_stripe 4."""
    rows, columns = pattern.grid
    return np.full(rows, 4.0), np.full(columns, 2.0)


RIDGES = ElectrodeLayout()


def laid(layout, periods=2, options=PERIODIC, unit_cells=(1, 1)):
    pattern = checkerboard(periods, unit_cells)
    return place_electrodes(layout, pattern, options, stitches(pattern))


def test_neighbouring_rib_ridges_of_the_first_patch_carry_a_stripe_each():
    first, second = laid(RIDGES).strips
    assert first == (Strip(1, 3, 0, 16),)
    assert second == (Strip(5, 7, 0, 16),)


@pytest.mark.parametrize(
    ("phase", "front", "back"), [("stripe_border", [2, 6], [4]), ("stripe_centre", [1, 5], [3, 7])]
)
def test_ridges_are_the_folds_of_the_middle_patch(phase, front, back):
    options = replace(PERIODIC, fold_phase=phase)
    for face, lines in {"front": front, "back": back, "both": sorted(front + back)}.items():
        assert ridge_lines(replace(RIDGES, face=face), checkerboard(2), options) == lines


def test_garter_ridges_run_along_courses():
    layout = replace(RIDGES, along="course")
    assert laid(layout).strips[0] == (Strip(0, 16, 1, 3),)
    valley = ModelOptions(boundary="periodic", garter_start="valley")
    assert ridge_lines(layout, checkerboard(2), valley) == [4]


def test_a_sample_is_plated_in_its_middle_patch_over_its_span():
    layout = replace(RIDGES, span=(0.25, 0.75))
    (strip,), _ = laid(layout, options=CLAMPED, unit_cells=(2, 3)).strips
    # With six patches across, the middle one is the third.
    assert strip == Strip(17, 19, 8, 24)


def test_within_the_fabric_ridges_of_all_patches_count():
    lines = ridge_lines(replace(RIDGES, within="fabric"), checkerboard(2), PERIODIC)
    assert lines == [2, 6, 10, 14]


@given(st.floats(0.1, 7.9))
def test_a_width_in_stitches_is_centred_on_its_ridge(width):
    for along, across in (("wale", 2.0), ("course", 4.0)):
        layout = replace(RIDGES, along=along, width=width)
        strips = laid(layout, options=PERIODIC).strips if width / across < 4 else None
        for number, (strip,) in enumerate(strips or ()):
            low, high = strip.extents[0 if along == "wale" else 1]
            assert high - low == pytest.approx(width / across)
            assert (low + high) / 2 == pytest.approx([2, 6][number])


def drawn(*rows):
    return replace(RIDGES, mask=rows)


SQUARE = patch_map(["R"], 1)


def refused(layout, pattern, options):
    with pytest.raises(BadLayout) as error:
        place_electrodes(layout, pattern, options, stitches(pattern))
    return str(error.value)


@pytest.mark.parametrize(
    ("layout", "options", "named"),
    [
        (replace(RIDGES, width=8.0), PERIODIC, ("short", "columns 4 to 4", "rows 0 to 16")),
        (replace(RIDGES, width=9.0), PERIODIC, ("short", "columns 3.75 to 4.25")),
        (replace(RIDGES, width=40.0), PERIODIC, ("electrode A", "columns -8 to 12")),
        (replace(RIDGES, width=9.0), CLAMPED, ("electrode A", "columns -0.25 to 4.25")),
        (replace(RIDGES, ridges=(1, 3)), PERIODIC, ("ridge 3", "has 2")),
        (replace(RIDGES, ridges=(1, 1)), PERIODIC, ("short", "columns 1 to 3")),
        (replace(RIDGES, span=(0.0, 0.5)), PERIODIC, ("span", "clamped")),
    ],
)
def test_an_impossible_layout_is_refused_with_its_place(layout, options, named):
    text = refused(layout, checkerboard(2), options)
    assert all(part in text for part in named)


@pytest.mark.parametrize(
    ("rows", "options", "named"),
    [
        (("A..B", "A..B", "A..B"), CLAMPED, ("3 rows of 4", "4 rows of 4")),
        (("A...",) * 4, CLAMPED, ("letter B",)),
        (("A..B", "A..B", "...B", "A..B"), CLAMPED, ("electrode A", "2 pieces", "column 0")),
        (("A..B", "A..B", "...B", "...B"), PERIODIC, ("electrode A", "boundary")),
        (("ABBB", "A..B", "A..B", "A..B"), CLAMPED, ("short", "columns 1 to 1", "rows 3 to 4")),
        ((".A.B", "..AB", "A..B", "A..B"), CLAMPED, ("electrode A", "3 pieces")),
    ],
)
def test_an_impossible_mask_is_refused_with_its_place(rows, options, named):
    text = refused(drawn(*rows), SQUARE, options)
    assert all(part in text for part in named)


@pytest.mark.parametrize("options", [CLAMPED, PERIODIC])
def test_a_drawn_electrode_need_not_be_straight(options):
    electrodes = place_electrodes(
        drawn("a..b", "aa.b", ".a.b", "aa.b"), SQUARE, options, stitches(SQUARE)
    )
    assert sum(strip.area for strip in electrodes.strips[0]) == 6
    # The first row of the drawing is the top of the fabric.
    assert Strip(0, 1, 3, 4) in electrodes.strips[0]
    assert Strip(0, 1, 1, 2) not in electrodes.strips[0]


def test_strips_that_overlap_are_named():
    strips = (Strip(0, 2, 0, 4), Strip(1, 3, 1, 2)), (Strip(4, 5, 0, 4),)
    mistakes = Electrodes(strips, "wale").mistakes(MeshShape(8, 8, False))
    assert len(mistakes) == 1
    assert "electrode A" in mistakes[0]
    assert "columns 1 to 2, rows 1 to 2" in mistakes[0]


@given(st.tuples(*[st.floats(0, 3)] * 4))
def test_each_piece_lies_in_one_cell_and_pieces_fill_their_strip(ends):
    left, width, bottom, height = ends
    strip = Strip(left, left + width + 0.1, bottom, bottom + height + 0.1)
    parts = split_by_cells(strip)
    assert sum(part.area for part in parts) == pytest.approx(strip.area)
    for part in parts:
        for low, high in part.extents:
            assert np.floor(low) >= np.ceil(high) - 1
