"""Margins: the verdict is their sign, they grow with the value, and a wider limit never fails."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.claims import margin as margins
from knitlab.claims.checks import weakest_significant
from knitlab.claims.claims import read_claims
from knitlab.claims.margin import CheckResult, Grade, above, below, within, worst
from tests.claims.test_claims import good_checkerboards

NUMBER = st.floats(allow_nan=False, allow_infinity=False)
ANY = st.floats()
STRICT = st.booleans()


@given(NUMBER, NUMBER, STRICT)
def test_a_margin_is_at_least_0_where_the_comparison_holds(value, limit, strict):
    met = value != limit or not strict
    assert (above(value, limit, strict=strict) >= 0) == (met and value >= limit)
    assert (below(value, limit, strict=strict) >= 0) == (met and value <= limit)


@given(NUMBER, NUMBER, NUMBER, STRICT)
def test_a_margin_never_falls_while_the_value_rises(one, other, limit, strict):
    low, high = sorted([one, other])
    assert above(low, limit, strict=strict) <= above(high, limit, strict=strict)
    assert below(low, limit, strict=strict) >= below(high, limit, strict=strict)


@given(NUMBER, NUMBER, NUMBER, st.floats(0, 1e6), st.floats(0, 1e6))
def test_wider_limits_never_turn_what_holds_into_what_fails(value, one, other, less, more):
    lowest, highest = sorted([one, other])
    if within(value, lowest, highest) >= 0:
        assert within(value, lowest - less, highest + more) >= 0


@given(ANY, ANY, STRICT)
def test_a_margin_is_never_infinite_or_nan(value, limit, strict):
    for found in (above(value, limit, strict=strict), below(value, limit, strict=strict)):
        if math.isfinite(value) and math.isfinite(limit):
            assert math.isfinite(found)
        else:
            assert found is None
            assert CheckResult(found, "").verdict is Grade.not_measured


@given(st.lists(st.none() | NUMBER))
def test_the_margin_of_many_is_that_of_the_worst(found):
    present = [each for each in found if each is not None]
    assert worst(found) == (min(present) if present else None)


@given(st.none() | st.floats(-2, 2))
def test_verdict_and_grade_agree(margin):
    result = CheckResult(margin, "")
    assert (result.verdict is Grade.holds) == (margin is not None and margin >= 0)
    assert (result.grade is Grade.near_miss) == (margin is not None and -0.25 <= margin < 0)
    if result.grade is not Grade.near_miss:
        assert result.grade is result.verdict


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (within(-0.8, -0.75, -0.15), -0.05 / 0.75),
        (within(-0.1, -0.75, -0.15), -0.05 / 0.15),
        (within(-0.3, -np.inf, 0.0), 0.3),
        (within(0.15, 0.1, 0.2), 0.25),
        (below(1.5, 2.0, strict=True), 0.25),
        (above(0.97, 0.98, scale=0.02), -0.5),
        (above(1.0, 0.0, scale=0.0), margins.MAX_MARGIN),
        (above(0.0, 0.0, strict=True), margins.MIN_MISS),
    ],
)
def test_margins_of_known_distances(found, expected):
    assert found == pytest.approx(expected)


def test_the_weakest_significant_rank_correlation_is_that_of_the_tables():
    """Critical values of Student's t test of a correlation, two-sided 5 %."""
    assert weakest_significant(20, 0.05) == pytest.approx(0.444, abs=5e-4)
    assert weakest_significant(10, 0.05) == pytest.approx(0.632, abs=5e-4)


LIMITED_BY_0 = [
    claim
    for claim in read_claims()
    if 0.0 in (claim.arguments.get("lowest"), claim.arguments.get("highest"))
]


@pytest.mark.parametrize("claim", LIMITED_BY_0, ids=lambda claim: claim.name)
def test_only_plain_numbers_are_held_against_0(claim):
    assert good_checkerboards()[claim.arguments["of"]].attrs["units"] == "1"
