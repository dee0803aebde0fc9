"""Solves after a few entries of the diagonal have changed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.solvers.factorisation.multifrontal import Multifrontal
from tests.solvers.factorisation.test_multifrontal import CASES, Case, factored, sheet

FREE, PERIODIC = CASES["free"], CASES["periodic"]


def changed(case: Case, unknowns: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Non-zeros of the lower triangle with a changed diagonal."""
    entries = case.lower.data.copy()
    entries[case.lower.indptr[unknowns]] += changes
    return entries


def some(case: Case, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).choice(len(case.rows), count, replace=False)


@pytest.mark.slow
@settings(max_examples=30)
@given(
    case=st.sampled_from([FREE, PERIODIC]),
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 40),
    largest=st.sampled_from([1e-3, 1.0, 1e4]),
)
def test_solves_are_those_of_the_changed_matrix(case, seed, count, largest):
    random = np.random.default_rng(seed)
    unknowns = some(case, count, seed)
    # A part of the diagonal may be taken away.
    own = case.matrix.diagonal()[unknowns]
    changes = np.where(
        random.random(count) < 0.5, largest * random.uniform(0.1, 1, count), -1e-3 * own
    )
    rhs = random.normal(size=len(case.rows))
    factors = case.factors()
    assert factors.change_diagonal(unknowns, changes)
    expected = factored(case.plan, changed(case, unknowns, changes)).solve(rhs)
    np.testing.assert_allclose(factors.solve(rhs), expected, rtol=0, atol=1e-12)


def test_the_last_change_holds_until_it_is_taken_back():
    case, rhs = FREE, np.ones(len(FREE.rows))
    factors, unknowns = case.factors(), some(FREE, 9)
    before = factors.solve(rhs)
    assert factors.change_diagonal(unknowns, np.full(9, 50.0))
    assert factors.change_diagonal(unknowns[:4], np.full(4, 2.0))
    expected = factored(case.plan, changed(case, unknowns[:4], np.full(4, 2.0))).solve(rhs)
    np.testing.assert_allclose(factors.solve(rhs), expected, rtol=0, atol=1e-12)
    assert factors.change_diagonal(unknowns[:0], np.zeros(0))
    np.testing.assert_array_equal(factors.solve(rhs), before)


def test_a_change_does_not_outlive_the_factor():
    case, rhs = FREE, np.ones(len(FREE.rows))
    factors, unknowns = case.factors(), some(FREE, 5)
    assert factors.change_diagonal(unknowns, np.full(5, 50.0))
    assert factors.factorise(2 * case.lower.data)
    np.testing.assert_allclose(2 * factors.solve(rhs), case.factors().solve(rhs), rtol=1e-12)
    assert factors.change_diagonal(unknowns, np.full(5, 1.0))
    expected = factored(case.plan, 2 * changed(case, unknowns, np.full(5, 0.5))).solve(rhs)
    np.testing.assert_allclose(factors.solve(rhs), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_a_change_that_makes_the_matrix_indefinite_is_refused(precision):
    case, rhs = sheet(13, 16), np.ones(3 * 13 * 16)
    factors = Multifrontal(case.plan, precision=precision)
    assert factors.factorise(case.lower.data)
    before, unknowns = factors.solve(rhs), some(case, 6)
    changes = np.array([5.0, 5.0, 5.0, -2 * case.matrix.diagonal()[unknowns[3]], 5.0, 5.0])
    assert not Multifrontal(case.plan).factorise(changed(case, unknowns, changes))
    assert not factors.change_diagonal(unknowns, changes)
    np.testing.assert_array_equal(factors.solve(rhs), before)
