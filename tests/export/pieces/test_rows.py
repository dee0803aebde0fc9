"""Rows of several kinds: which are chosen, against fabrics whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.export.pieces.rows import Row, WantedWidening, chosen_rows
from tests.export.pieces.test_piece import fabric

STRAIN = np.linspace(0, 1, 11)


def linear(label, stiffness, ratio, height=5.0):
    """Rows of one patch of 8 cells, whose force and widening are in proportion to their strain."""
    case = fabric().case
    return Row(
        label=label,
        stripe=case.warp,
        periods=2,
        is_plain=False,
        cell=(1.0, height / 8),
        strain=STRAIN,
        force=stiffness * STRAIN,
        widening=ratio * STRAIN,
    )


def chosen(kinds, widening, stretch=0.1, length=200.0, width=lambda y: 100.0):
    place = np.linspace(0, 1, len(widening))
    wanted = WantedWidening(stretch, place, np.array(widening))
    return chosen_rows(kinds, 4, length, width, wanted)


def test_rows_that_widen_are_where_widening_is_wanted():
    wide, narrow = linear("wide", 1.0, 1.0), linear("narrow", 1.0, 0.0)
    rows = chosen([wide, narrow], [0.0, 0.0, 0.1, 0.1])
    labels = [row.label for row in rows]
    assert len(rows) == 40
    assert labels == ["narrow"] * 20 + ["wide"] * 20


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.floats(0.2, 5.0))
def test_stiff_rows_widen_less_by_the_ratio_of_stiffnesses(ratio):
    """Two kinds of equal Poisson's ratio in series: strains are inverse to their stiffness."""
    soft, stiff = linear("soft", 1.0, 1.0), linear("stiff", ratio, 1.0)
    rows = chosen([soft, stiff], [0.02, 0.18] if ratio > 1 else [0.18, 0.02])
    numbers = [sum(row.label == label for row in rows) for label in ("soft", "stiff")]
    strains = [row.under(0.05)[0] for row in (soft, stiff)]
    assert strains[0] == pytest.approx(ratio * strains[1])
    assert sum(numbers) == 40


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.floats(0.02, 0.4))
def test_the_piece_has_the_wanted_stretch(stretch):
    kinds = [linear("soft", 1.0, 0.5), linear("stiff", 3.0, 0.5)]
    rows = chosen(kinds, [0.5 * stretch] * 2, stretch)
    # All rows are of one kind, in which the wanted widening is that of the wanted stretch.
    assert len({row.label for row in rows}) == 1


def test_narrow_places_bear_more_force_over_their_width():
    """With half the width, a row twice as stiff widens alike."""
    soft, stiff = linear("soft", 1.0, 1.0), linear("stiff", 2.0, 1.0)
    rows = chosen([soft, stiff], [0.1, 0.1], width=lambda y: 50.0 if y < 100 else 100.0)
    labels = [row.label for row in rows]
    assert labels[:20] == ["stiff"] * 20
    assert labels[20:] == ["soft"] * 20


@pytest.mark.parametrize(("length", "expected"), [(200.0, 40), (202.0, 40), (203.0, 41), (4.0, 1)])
def test_the_length_is_that_of_the_nearest_number_of_rows(length, expected):
    assert len(chosen([linear("own", 1.0, 1.0)], [0.1, 0.1], length=length)) == expected
